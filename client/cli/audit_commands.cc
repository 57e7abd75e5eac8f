// audit verify, audit show.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <deque>
#include <iostream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands.h"
#include "client/connection/daemon_client.h"
#include "protocol/base/file_writer.h"
#include "protocol/base/hash_chain.h"

namespace mesorig::client {
namespace {

constexpr size_t kMaxAnchors = 256u << 20;  // bytes of a file of them

struct AuditOptions {
  std::string state_dir, anchors, call;
  std::vector<std::string> heads;
  uint64_t last = 0;
};

Status ReadLog(const Common& common, const AuditOptions& options,
               const std::function<void(std::string_view)>& on_bytes) {
  if (options.state_dir.empty()) {
    MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
    return daemon->ReadAudit(0, on_bytes);
  }
  const auto path = std::filesystem::path(options.state_dir) / "audit.jsonl";
  FILE* in = std::fopen(path.c_str(), "rb");
  if (in == nullptr) return NotFound("{}: cannot be read", path.string());
  std::string piece(1u << 16, '\0');
  while (const size_t n = std::fread(piece.data(), 1, piece.size(), in)) {
    on_bytes(std::string_view(piece).substr(0, n));
  }
  const bool failed = std::ferror(in) != 0;
  std::fclose(in);
  return failed ? Unavailable("{}: reading failed", path.string()) : OkStatus();
}

StatusOr<std::vector<ChainHead>> Anchors(const AuditOptions& options) {
  std::vector<ChainHead> anchors;
  for (const std::string& head : options.heads) {
    const bool hex =
        head.size() == 64 && head.find_first_not_of("0123456789abcdef") == std::string::npos;
    if (!hex) return InvalidArgument("--head {}: not 64 lower-case hexadecimal digits", head);
    anchors.push_back({0, head});
  }
  if (options.anchors.empty()) return anchors;
  std::string text;
  if (options.anchors == "-") {
    text.assign(std::istreambuf_iterator<char>(std::cin), {});
  } else {
    MESORIG_ASSIGN_OR_RETURN(text, ReadFile(options.anchors, kMaxAnchors));
  }
  for (ChainHead& anchor : FindAnchors(text)) anchors.push_back(std::move(anchor));
  return anchors;
}

// Logs that the daemon found damaged and put aside.
std::vector<std::string> PutAside(const std::string& state_dir) {
  std::vector<std::string> names;
  std::error_code error;
  if (state_dir.empty()) return names;
  for (const auto& entry : std::filesystem::directory_iterator(state_dir, error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("audit.jsonl.damaged-")) names.push_back(name);
  }
  return names;
}

Status Verify(const Common& common, const AuditOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(const std::vector<ChainHead> anchors, Anchors(options));
  ChainVerifier verifier;
  for (const ChainHead& anchor : anchors) verifier.Expect(anchor);
  MESORIG_RETURN_IF_ERROR(
      ReadLog(common, options, [&](std::string_view bytes) { verifier.Add(bytes); }));
  const ChainReport report = verifier.Finish();
  const std::vector<std::string> aside = PutAside(options.state_dir);
  if (common.json) {
    nlohmann::json lacking = nlohmann::json::array();
    for (const ChainHead& head : report.lacking) {
      lacking.push_back({{"sequence", head.sequence}, {"hash", head.hash}});
    }
    fmt::print("{}\n", nlohmann::json({{"entries", report.head.sequence},
                                       {"head", report.head.hash},
                                       {"bad_entry", report.bad_entry},
                                       {"wrong", report.wrong},
                                       {"torn_bytes", report.torn_bytes},
                                       {"anchors", anchors.size()},
                                       {"lacking", lacking},
                                       {"put_aside", aside}})
                           .dump());
  } else {
    fmt::print("{} entries, {} of {} anchors found; {}\n", report.head.sequence,
               anchors.size() - report.lacking.size(), anchors.size(), AnchorText(report.head));
    if (report.torn_bytes > 0) {
      fmt::print("at the end {} bytes of an entry that was not finished, as a kill leaves them\n",
                 report.torn_bytes);
    }
    for (const std::string& name : aside) fmt::print("{}: found damaged and put aside\n", name);
  }
  if (report.bad_entry != 0) return DataLoss("entry {} {}", report.bad_entry, report.wrong);
  if (!report.lacking.empty()) {
    const ChainHead& first = report.lacking.front();
    return DataLoss("no entry {} with hash {}: entries were cut off, or all was made anew",
                    first.sequence, first.hash);
  }
  if (!aside.empty()) return DataLoss("{} logs were found damaged before", aside.size());
  return OkStatus();
}

std::string EntryText(const nlohmann::json& entry) {
  const auto text = [&](const char* key) { return entry.value(key, std::string()); };
  const std::string via = text("via").empty() ? "" : " via " + text("via");
  return fmt::format("{:>6} {} {:<16} {:<13} {}{}  {}  {}", entry.value("sequence", 0ULL),
                     text("utc"), text("name"), text("role"), text("peer"), via, text("call"),
                     text("what")) +
         "  -> " + text("outcome");
}

Status Show(const Common& common, const AuditOptions& options) {
  std::deque<std::string> lines;
  std::string rest;
  const auto show = [&](const std::string& line) {
    const auto entry = nlohmann::json::parse(line, nullptr, false);
    if (entry.is_discarded() || !entry.is_object()) {
      fmt::print("(not an entry: see `mesorig audit verify`)\n");
      return;
    }
    if (!options.call.empty() && entry.value("call", std::string()) != options.call) return;
    fmt::print("{}\n", common.json ? line : EntryText(entry));
  };
  MESORIG_RETURN_IF_ERROR(ReadLog(common, options, [&](std::string_view bytes) {
    rest += bytes;
    size_t begin = 0;
    for (size_t end = 0; (end = rest.find('\n', begin)) != std::string::npos; begin = end + 1) {
      lines.push_back(rest.substr(begin, end - begin));
      if (options.last > 0 && lines.size() > options.last) lines.pop_front();
      if (options.last > 0) continue;
      show(lines.front());
      lines.pop_front();
    }
    rest.erase(0, begin);
  }));
  for (const std::string& line : lines) show(line);
  return OkStatus();
}

}  // namespace

std::vector<Command> AddAuditCommands(CLI::App& app, Common& common) {
  CLI::App* audit = app.add_subcommand("audit", "Who did what with the rig");
  audit->require_subcommand(1);
  audit->fallthrough();
  auto options = std::make_shared<AuditOptions>();
  CLI::App* verify = audit->add_subcommand(
      "verify", "Find any change, cut or insertion; exits 1 and names the first bad entry");
  verify->add_option("--head", options->heads, "Hash of an entry that must be there; several");
  verify->add_option("--anchors", options->anchors,
                     "File (- for stdin) in which the heads were noted, as the system journal: "
                     "journalctl -t mesorigd -o cat | mesorig audit verify --anchors -");
  CLI::App* show = audit->add_subcommand("show", "The entries, oldest first");
  show->add_option("--last", options->last, "Only so many");
  show->add_option("--call", options->call, "Only those of one call, as Control/Run");
  for (CLI::App* command : {verify, show}) {
    command->add_option("--state-dir", options->state_dir,
                        "Read the file of a state folder, without a daemon");
  }
  return {{verify, [&common, options] { return Verify(common, *options); }},
          {show, [&common, options] { return Show(common, *options); }}};
}

}  // namespace mesorig::client
