#include "daemon/app/access_options.h"

namespace mesorig::daemon {

void AddAccessOptions(CLI::App& app, AccessOptions& options) {
  auto* listen = app.add_option("--listen", options.listen,
                                "HOST:PORT for clients over the network, by mutual TLS only "
                                "(port 0: a free one)");
  auto* folder = app.add_option("--tls-dir", options.tls_dir,
                                "Folder with key.pem, cert.pem, ca.pem and the list `allowed` "
                                "(mesorig certs)");
  listen->needs(folder);
  app.add_option("--max-certificate-days", options.gate.max_certificate_days,
                 "Certificates that are valid for longer are refused")
      ->capture_default_str();
  app.add_option_function<std::vector<std::string>>(
      "--group",
      [&options](const std::vector<std::string>& pairs) {
        for (const std::string& pair : pairs) {
          const size_t equals = pair.find('=');
          const Role role = RoleNamed(pair.substr(0, equals));
          if (equals == std::string::npos || equals + 1 == pair.size() || role == Role::kNone) {
            throw CLI::ValidationError("--group",
                                       "\"" + pair +
                                           "\" is not ROLE=GROUP, with a role of observer, "
                                           "processing, operator, administrator");
          }
          options.groups[role] = pair.substr(equals + 1);
        }
      },
      "ROLE=GROUP: members of the group may open the role's socket, beside mesorigd's own user");
}

}  // namespace mesorig::daemon
