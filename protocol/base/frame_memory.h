#pragma once
// Frames come and go all night, a megabyte each. Left alone, malloc maps and unmaps each of them: a
// page fault every 4 KiB, a third of what streaming a frame costs.

namespace mesorig {

// Freed memory is kept for the next frames, up to 128 MiB an arena. Once, before there are threads.
void KeepFreedFrames();

// Back to the system with it: no frame comes for a while. Any thread.
void ReturnFreedFrames();

}  // namespace mesorig
