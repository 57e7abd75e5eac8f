// The parts of a compressed BTF behind OpenEXR (coded_btf.h), for every codec. What is decoded is
// finite everywhere, and its planes decode again; what is refused names the part. Half of the mutations
// know what a plane is.

#include <cstring>
#include <random>

#include "processing/codecs/codec.h"
#include "tests/fuzz/coded_btf.h"
#include "tests/fuzz/decode_some.h"

extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t most);

namespace mesorig {
namespace {

// One plane, or one pair's presence, becomes another of the same kind.
void Change(btf::CodedBtf& coded, std::mt19937& random) {
  constexpr float kNasty[] = {0,    1,     -1,     127,    -128,     0.5f, 1e-45f, 65504,
                              1e9f, -1e9f, 3.4e38f, -3.4e38f, 0x1p100f, 0x1p-100f, 0x1p60f};
  const auto nasty = [&] { return kNasty[random() % std::size(kNasty)]; };
  if (coded.planes.empty()) return;
  auto at = coded.planes.begin();
  std::advance(at, static_cast<std::ptrdiff_t>(random() % coded.planes.size()));
  btf::Plane& plane = at->second;
  switch (random() % 8) {
    case 0:
      if (random() % 4 == 0) coded.info.value_scale = std::exp2(static_cast<int>(random() % 800) - 400);
      coded.info.present[random() % coded.info.present.size()] ^= 1;
      return;
    case 1:
      std::fill(plane.values.begin(), plane.values.end(), nasty());
      return;
    case 2:
      std::swap(plane.width, plane.height);
      return;
    case 3:  // the last channel goes
      if (plane.channels.size() < 2) return;
      plane.values.resize(plane.values.size() / plane.channels.size() *
                          (plane.channels.size() - 1));
      plane.channels.pop_back();
      return;
    case 4:
      plane.half = !plane.half, plane.bytes = random() % 2 != 0;
      return;
    default:
      for (size_t i = 1 + random() % 4; i > 0; --i) {
        plane.values[random() % plane.values.size()] = nasty();
      }
  }
}

}  // namespace
}  // namespace mesorig

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t most, unsigned seed) {
  using namespace mesorig;
  std::mt19937 random(seed);
  std::optional<btf::CodedBtf> coded = fuzz::Unpack(fuzz::View(data, size));
  if (!coded || random() % 2 == 0) return LLVMFuzzerMutate(data, size, most);
  for (size_t i = 1 + random() % 3; i > 0; --i) Change(*coded, random);
  const std::string bytes = fuzz::Pack(*coded);
  if (bytes.size() > most) return LLVMFuzzerMutate(data, size, most);
  std::memcpy(data, bytes.data(), bytes.size());
  return bytes.size();
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  std::optional<btf::CodedBtf> coded = fuzz::Unpack(fuzz::View(data, size));
  if (!coded) return 0;
  const auto decoder = codecs::FindDecoder(coded->info.codec);
  if (!decoder.ok()) return 0;
  const auto encoded = (*decoder)->Decode(*std::move(coded));
  if (!encoded.ok()) {
    MESORIG_CHECK(absl::IsInvalidArgument(encoded.status()) && !Message(encoded.status()).empty());
    return 0;
  }
  fuzz::DecodeSome(**encoded);
  btf::CodedBtf again;
  again.info = (*encoded)->info();
  for (btf::Plane& plane : (*encoded)->Planes()) {
    const std::string name = plane.name;
    again.planes.emplace(name, std::move(plane));
  }
  MESORIG_CHECK((*decoder)->Decode(std::move(again)).ok());
  return 0;
}
