#include "protocol/base/frame_memory.h"

#include <malloc.h>

namespace mesorig {

void KeepFreedFrames() {
  ::mallopt(M_MMAP_THRESHOLD, 32 << 20);  // (the most that it takes)
  ::mallopt(M_TRIM_THRESHOLD, 128 << 20);
}

void ReturnFreedFrames() { ::malloc_trim(0); }

}  // namespace mesorig
