#pragma once
// What mesorigd is told: by a file (--config, docs/operations.md) and by its command line, which has
// the last word.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "daemon/service/access.h"
#include "daemon/service/notifier.h"
#include "protocol/base/log.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

struct Settings {
  std::string rig;          // rig file
  std::string state_dir;    // sessions live below it
  std::string runtime_dir;  // where programs find each other
  LogOptions log;
  std::optional<int> metrics_port;  // none: no metrics; 0: any free port
  NotifierOptions notify;
  AccessOptions access;     // who may call
};

// Adds what the file says to `settings`. NotFound; InvalidArgument with file:line:column for what is
// wrong or unknown. Relative paths are relative to the file's folder.
Status ReadSettings(const std::filesystem::path& file, Settings& settings);
Status ParseSettings(std::string_view text, std::string_view name,
                     const std::filesystem::path& folder, Settings& settings);

// As a file would say it, with "(left out)" for everything that may be a secret.
std::string SettingsText(const Settings& settings);

// Texts that nobody else may see: the webhook's path, values of headers, arguments of the command.
std::vector<std::string> SecretsOf(const Settings& settings);
// `text` with "(left out)" for each of them, and for private keys in PEM.
std::string WithoutSecrets(std::string text, const std::vector<std::string>& secrets);

// What a daemon that runs cannot take up from another file: names of settings that differ and need
// a restart.
std::vector<std::string> NeedRestart(const Settings& running, const Settings& wanted);

}  // namespace mesorig::daemon
