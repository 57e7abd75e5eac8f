// write_seeds DIR: seeds that are not text, made of what the repository has, into DIR/<target>/.

#include "processing/codecs/encoder.h"
#include "protocol/base/bytes.h"
#include "protocol/base/digest.h"
#include "protocol/sim_wire/envelope.h"
#include "protocol/sim_wire/payloads.h"
#include "tests/daemon/session/session_fixture.h"
#include "tests/fuzz/coded_btf.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig {
namespace {

class Seeds {
 public:
  explicit Seeds(std::filesystem::path dir) : dir_(std::move(dir)) {}
  void Add(std::string_view target, std::string_view name, std::string_view bytes) const {
    std::filesystem::create_directories(dir_ / target);
    fuzz::Overwrite(dir_ / target / name, bytes);
  }

 private:
  std::filesystem::path dir_;
};

void Plans(const Seeds& seeds) {
  const Rig rig = daemon::SmallRig();
  seeds.Add("plan_bin", "lamps", PackPlan(daemon::SmallPlan(rig)));
  seeds.Add("plan_bin", "sweeps", PackPlan(daemon::SweepingPlan(rig)));
  const Rig demo = LoadRig(fuzz::Source("rigs/demo.toml")).value();
  CompiledPlan plan = CompilePlanFile(fuzz::Source("plans/demo.toml"), demo).value();
  plan.steps.erase(plan.steps.begin() + 40, plan.steps.end());
  seeds.Add("plan_bin", "demo", PackPlan(plan));
}

// A session of sweeps, and of its files the journal and a segment.
void Sessions(const Seeds& seeds) {
  const fuzz::ScratchFolder scratch;
  const Rig rig = daemon::SmallRig();
  const CompiledPlan plan = daemon::SweepingPlan(rig);
  auto session = daemon::Session::Create(scratch.path(), plan, rig).value();
  MESORIG_CHECK(daemon::AppendAll(*session, plan).ok());
  MESORIG_CHECK(session->Finish(true, "", 1, 1, true).ok());
  const auto folder = scratch.path() / session->id();
  seeds.Add("journal", "sweeps", ReadFile(folder / "journal.sqlite").value());
  const std::string segment = ReadFile(folder / "cam0.seg").value();
  for (const uint64_t cursor : {0, 2, 5}) {
    const daemon::FrameRecord row = session->Next(0, cursor, 0).value()->record;
    ByteWriter out;
    out.Put(row.offset).Put(row.bytes).Put(row.sequence).PutRaw(row.digest).PutRaw(segment);
    seeds.Add("segment", fmt::format("frame{}", row.sequence), out.bytes());
  }
}

void Messages(const Seeds& seeds) {
  using namespace sim_wire;
  const Welcome welcome{
      Sha256("rig"), 7, RigTime{}, {"can", "lamps", "lines", "camera:A"}, "127.0.0.1:502"};
  CameraFrame frame;
  frame.trigger_id = 3, frame.frame_id = 9, frame.width = 4, frame.height = 2, frame.bits = 12;
  frame.pixels = std::string(16, 'p');
  std::string stream;
  AppendMessage({MessageType::kHello, 0, 1, RigTime{}, std::string("\1\0\0", 3)}, stream);
  AppendMessage({MessageType::kWelcome, 0, 1, RigTime{}, Pack(welcome)}, stream);
  AppendMessage({MessageType::kCommand, 0, 2, RigTime{}, Pack(CanFrame{0x605, 2, {1, 2}})}, stream);
  AppendMessage({MessageType::kOutput, 2, 0, RigTime{}, Pack(LineEdge{1, 0})}, stream);
  AppendMessage({MessageType::kQuery, 2, 4, RigTime{}, PackLineQuery(1)}, stream);
  AppendMessage({MessageType::kReply, 3, 4, RigTime{}, PackRegisterValue(0.5)}, stream);
  AppendMessage({MessageType::kQuery, 3, 5, RigTime{},
                 Pack(CameraAccess{CameraRegister::kExposureS, true, 0.02})},
                stream);
  AppendMessage({MessageType::kCommand, 3, 6, RigTime{}, Pack(CameraTrigger{3})}, stream);
  AppendMessage({MessageType::kOutput, 3, 0, RigTime{}, Pack(frame)}, stream);
  seeds.Add("sim_wire", "stream", '\7' + stream);
  seeds.Add("sim_wire", "welcome", '\1' + Pack(welcome));
  seeds.Add("sim_wire", "camera_frame", '\1' + Pack(frame));
}

// A small BTF by every codec at one setting: its file, and its parts alone.
void Compressed(const Seeds& seeds, const btf::SampledBtf& btf, const std::string& setting,
                const codecs::EncodeOptions& options) {
  const fuzz::ScratchFolder scratch;
  for (const codecs::Encoder* encoder : codecs::AllEncoders()) {
    const auto encoded = encoder->Encode(btf, options);
    if (!encoded.ok()) continue;  // has no such option
    const auto path = scratch.path() / "a.btf.exr";
    MESORIG_CHECK(codecs::WriteEncodedBtf(**encoded, path).ok());
    const std::string name = fmt::format("{}-{}", encoder->name(), setting);
    seeds.Add("btf_file", name, ReadFile(path).value());
    btf::CodedBtf coded = btf::ReadCodedBtf(path).value();
    seeds.Add("codec_parts", name, fuzz::Pack(coded));
    for (const float huge : {0x1p60f, 0x1p100f, 3.4e38f}) {  // factors that leave float together
      for (auto& [part, plane] : coded.planes) {
        if (!plane.half && !plane.bytes) std::fill(plane.values.begin(), plane.values.end(), huge);
      }
      seeds.Add("codec_parts", fmt::format("{}-{:a}", name, huge), fuzz::Pack(coded));
    }
  }
}

void Btfs(const Seeds& seeds) {
  const auto directions = btf::RingDirections(1, 3, 40);
  btf::BtfHeader header = btf::SmallHeader(3, 2, directions, directions);
  const btf::SampledBtf btf = btf::SyntheticBtf(header, 0.2);
  Compressed(seeds, btf, "half", {});
  codecs::EncodeOptions options;
  options.quantisation = codecs::Quantisation::kByte;
  Compressed(seeds, btf, "bytes", options);
  options.weighting = codecs::Weighting::kLog;
  options.terms = 1;
  Compressed(seeds, btf, "log", options);
  options = {};
  options.clusters = 2;
  Compressed(seeds, btf, "clusters", options);
  header.mask = {1, 1, 0, 1, 1, 1};
  const fuzz::ScratchFolder scratch;
  MESORIG_CHECK(btf::WriteSampledBtf(btf::SyntheticBtf(header, 0.2), scratch.path() / "a").ok());
  seeds.Add("btf_file", "raw", ReadFile(scratch.path() / "a").value());
}

}  // namespace
}  // namespace mesorig

int main(int argc, char** argv) {
  MESORIG_CHECK(argc == 2);
  const mesorig::Seeds seeds(argv[1]);
  mesorig::Plans(seeds);
  mesorig::Sessions(seeds);
  mesorig::Messages(seeds);
  mesorig::Btfs(seeds);
  return 0;
}
