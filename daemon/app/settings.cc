#include "daemon/app/settings.h"

#include <fmt/ranges.h>

#include <cmath>

#include "protocol/base/file_writer.h"
#include "protocol/base/toml_reader.h"

namespace mesorig::daemon {
namespace {

constexpr std::string_view kLeftOut = "(left out)";
constexpr size_t kMaxFile = 1u << 20;
constexpr size_t kShortestSecret = 4;  // what is shorter would blacken every text

void ReadPath(TomlTable& table, const char* key, const std::filesystem::path& folder,
              std::string& path) {
  if (!table.Has(key)) return;
  const std::filesystem::path value = table.String(key);
  path = value.is_absolute() ? value.string() : (folder / value).lexically_normal().string();
}

void ReadLog(TomlTable table, LogOptions& log) {
  log.levels = table.StringOr("levels", log.levels);
  if (table.Has("format")) {
    log.format =
        table.Word("format", {"text", "json"}) == "json" ? LogFormat::kJson : LogFormat::kText;
  }
  if (const Status status = CheckLogging(log); !status.ok()) table.Error("levels", Message(status));
}

void ReadNotify(TomlTable table, NotifierOptions& notify) {
  if (table.Has("command")) notify.command = table.Strings("command");
  notify.webhook = table.StringOr("webhook", notify.webhook);
  if (table.Has("headers")) notify.headers = table.Strings("headers");
  if (table.Has("on")) notify.on = table.Strings("on");
  constexpr Range kLimit{0.1, 300};
  const double limit_s =
      table.NumberOr("timeout_s", static_cast<double>(notify.limit.count()) / 1e3, kLimit);
  if (limit_s >= kLimit.low && limit_s <= kLimit.high) {  // (else it was said above, with its line)
    notify.limit = std::chrono::milliseconds(std::llround(limit_s * 1e3));
  }
  if (const Status status = CheckNotifier(notify); !status.ok()) table.Error("", Message(status));
}

// Groups whose members may open the socket of a role.
void ReadAccess(TomlTable table, const std::filesystem::path& folder, AccessOptions& access) {
  access.listen = table.StringOr("listen", access.listen);
  std::string tls_dir = access.tls_dir.string();
  ReadPath(table, "tls_dir", folder, tls_dir);
  access.tls_dir = tls_dir;
  auto groups = table.TableIfPresent("groups");
  if (!groups) return;
  access.groups.clear();
  for (int i = 1; i < kRoles; ++i) {
    const auto role = static_cast<Role>(i);
    const std::string group = groups->StringOr(Name(role), "");
    if (!group.empty()) access.groups[role] = group;
  }
}

std::string Quoted(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      quoted += '\\';
      quoted += c;
    } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      quoted += fmt::format("\\u{:04x}", static_cast<unsigned char>(c));
    } else {
      quoted += c;
    }
  }
  return quoted + '"';
}

std::string QuotedList(const std::vector<std::string>& texts) {
  std::vector<std::string> quoted;
  for (const std::string& text : texts) quoted.push_back(Quoted(text));
  return fmt::format("[{}]", fmt::join(quoted, ", "));
}

// "https://host" of an address; what comes after it may be a secret, and a user before the host.
std::string HostOf(const std::string& url) {
  const size_t host = url.find("://") + 3;
  const std::string authority = url.substr(host, url.find_first_of("/?#", host) - host);
  const size_t at = authority.rfind('@');
  return url.substr(0, host) + (at == authority.npos ? authority : authority.substr(at + 1));
}

// Without what lies between "-----BEGIN … PRIVATE KEY-----" and its end.
void LeaveOutKeys(std::string& text) {
  constexpr std::string_view kBegin = "-----BEGIN ", kKey = "PRIVATE KEY-----", kEnd = "-----END ";
  size_t from = 0;
  while ((from = text.find(kBegin, from)) != text.npos) {
    const size_t line_end = std::min(text.find('\n', from), text.size());
    const size_t key = text.find(kKey, from);
    if (key == text.npos || key > line_end) {
      from += kBegin.size();
      continue;
    }
    const size_t end = text.find(kEnd, key);
    const size_t last = end == text.npos ? text.size() : std::min(text.find('\n', end), text.size());
    text.replace(from, last - from, kLeftOut);
    from += kLeftOut.size();
  }
}

}  // namespace

Status ParseSettings(std::string_view text, std::string_view name,
                     const std::filesystem::path& folder, Settings& settings) {
  MESORIG_ASSIGN_OR_RETURN(TomlFile file, TomlFile::Parse(text, name));
  TomlTable root = file.root();
  Settings read = settings;
  ReadPath(root, "rig", folder, read.rig);
  ReadPath(root, "state_dir", folder, read.state_dir);
  ReadPath(root, "runtime_dir", folder, read.runtime_dir);
  if (const auto log = root.TableIfPresent("log")) ReadLog(*log, read.log);
  if (auto metrics = root.TableIfPresent("metrics")) {
    read.metrics_port = static_cast<int>(metrics->Integer("port", {0, 65535}));
  }
  if (const auto access = root.TableIfPresent("access")) ReadAccess(*access, folder, read.access);
  if (const auto notify = root.TableIfPresent("notify")) ReadNotify(*notify, read.notify);
  MESORIG_RETURN_IF_ERROR(file.Finish());
  settings = std::move(read);
  return OkStatus();
}

Status ReadSettings(const std::filesystem::path& file, Settings& settings) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(file, kMaxFile));
  std::error_code error;
  const auto folder = std::filesystem::absolute(file, error).parent_path();
  return ParseSettings(text, file.string(), folder, settings);
}

std::string SettingsText(const Settings& settings) {
  std::string text = fmt::format(
      "rig = {}\nstate_dir = {}\nruntime_dir = {}\n\n[log]\nlevels = {}\nformat = \"{}\"\n",
      Quoted(settings.rig), Quoted(settings.state_dir), Quoted(settings.runtime_dir),
      Quoted(settings.log.levels), settings.log.format == LogFormat::kJson ? "json" : "text");
  if (settings.metrics_port) {
    text += fmt::format("\n[metrics]\nport = {}\n", *settings.metrics_port);
  }
  const AccessOptions& access = settings.access;
  if (!access.listen.empty() || !access.tls_dir.empty() || !access.groups.empty()) {
    text += "\n[access]\n";
    if (!access.listen.empty()) text += fmt::format("listen = {}\n", Quoted(access.listen));
    if (!access.tls_dir.empty()) {
      text += fmt::format("tls_dir = {}\n", Quoted(access.tls_dir.string()));
    }
    if (!access.groups.empty()) text += "\n[access.groups]\n";
    for (const auto& [role, group] : access.groups) {
      text += fmt::format("{} = {}\n", Name(role), Quoted(group));
    }
  }
  const NotifierOptions& notify = settings.notify;
  if (notify.command.empty() && notify.webhook.empty()) return text;
  text += fmt::format("\n[notify]\non = {}\ntimeout_s = {}\n", QuotedList(notify.on),
                      static_cast<double>(notify.limit.count()) / 1e3);
  if (!notify.command.empty()) {
    std::vector<std::string> command = notify.command;
    for (size_t i = 1; i < command.size(); ++i) command[i] = kLeftOut;
    text += fmt::format("command = {}\n", QuotedList(command));
  }
  if (!notify.webhook.empty()) {
    text += fmt::format("webhook = {}\n",
                        Quoted(fmt::format("{}/{}", HostOf(notify.webhook), kLeftOut)));
  }
  if (!notify.headers.empty()) {
    std::vector<std::string> headers = notify.headers;
    for (std::string& header : headers) {
      header = fmt::format("{}: {}", header.substr(0, header.find(':')), kLeftOut);
    }
    text += fmt::format("headers = {}\n", QuotedList(headers));
  }
  return text;
}

std::vector<std::string> SecretsOf(const Settings& settings) {
  std::vector<std::string> secrets;
  const auto add = [&](std::string_view text) {
    while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
    if (text.size() >= kShortestSecret) secrets.emplace_back(text);
  };
  const NotifierOptions& notify = settings.notify;
  for (size_t i = 1; i < notify.command.size(); ++i) add(notify.command[i]);
  for (const std::string& header : notify.headers) {
    const std::string_view value = std::string_view(header).substr(header.find(':') + 1);
    add(value);
    add(value.substr(std::min(value.size(), value.rfind(' ') + 1)));  // of "Bearer TOKEN"
  }
  if (!notify.webhook.empty()) {
    const std::string& url = notify.webhook;
    const size_t host = url.find("://") + 3;
    const size_t path = std::min(url.find_first_of("/?#", host), url.size());
    add(std::string_view(url).substr(path));
    const size_t at = url.rfind('@', path);
    if (at != url.npos && at > host) add(std::string_view(url).substr(host, at - host));
    // Parts of the path and of the query, as a log may quote one alone.
    for (size_t from = path; from < url.size();) {
      const size_t end = std::min(url.find_first_of("/?&=#", from + 1), url.size());
      if (end - from > 8) add(std::string_view(url).substr(from + 1, end - from - 1));
      from = end;
    }
  }
  return secrets;
}

std::string WithoutSecrets(std::string text, const std::vector<std::string>& secrets) {
  for (const std::string& secret : secrets) {
    for (size_t at = 0; (at = text.find(secret, at)) != text.npos; at += kLeftOut.size()) {
      text.replace(at, secret.size(), kLeftOut);
    }
  }
  LeaveOutKeys(text);
  return text;
}

std::vector<std::string> NeedRestart(const Settings& running, const Settings& wanted) {
  std::vector<std::string> names;
  const auto compare = [&](const char* name, const auto& a, const auto& b) {
    if (a != b) names.emplace_back(name);
  };
  compare("rig", running.rig, wanted.rig);
  compare("state_dir", running.state_dir, wanted.state_dir);
  compare("runtime_dir", running.runtime_dir, wanted.runtime_dir);
  compare("metrics.port", running.metrics_port, wanted.metrics_port);
  compare("access.listen", running.access.listen, wanted.access.listen);
  compare("access.tls_dir", running.access.tls_dir, wanted.access.tls_dir);
  compare("access.groups", running.access.groups, wanted.access.groups);
  return names;
}

}  // namespace mesorig::daemon
