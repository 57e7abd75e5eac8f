// certs ...: a laboratory's certificates (docs/access.md). None of it talks to a daemon.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "client/cli/commands.h"
#include "protocol/base/file_writer.h"
#include "protocol/wire/certificates.h"
#include "protocol/wire/token.h"

namespace mesorig::client {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMaxFile = 1u << 20;

int64_t Now() { return static_cast<int64_t>(std::time(nullptr)); }

struct CertsOptions {
  std::string ca, name = "mesorig-laboratory", role, out, who, allowed, gateway;
  std::vector<std::string> hosts;
  int days = wire::kDefaultDays;
  int64_t seconds = wire::kTokenLife_s;
  fs::path list() const { return allowed.empty() ? fs::path(ca) / "allowed" : fs::path(allowed); }
};
using Shared = std::shared_ptr<CertsOptions>;

Status Init(const CertsOptions& options, const Common& common) {
  MESORIG_RETURN_IF_ERROR(wire::CreateAuthority(options.ca, options.name, Now()));
  if (common.json) {
    fmt::print("{}\n", nlohmann::json{{"ca", options.ca}}.dump());
  } else {
    fmt::print(
        "{}: a CA for {} days. Who reads its ca.key can make anybody an administrator: keep "
        "the folder off the rig.\n",
        options.ca, wire::kAuthorityDays);
  }
  return OkStatus();
}

Status Issue(const CertsOptions& options, const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(
      const wire::CertificateFields fields,
      wire::FieldsFor(options.role, options.name, options.hosts, Now(), options.days));
  MESORIG_ASSIGN_OR_RETURN(const wire::Identity identity,
                           wire::IssueCertificate(options.ca, options.out, fields));
  if (common.json) {
    const nlohmann::json json = {{"name", identity.name},
                                 {"role", identity.role},
                                 {"fingerprint", identity.fingerprint},
                                 {"not_after_s", identity.not_after_s},
                                 {"folder", options.out}};
    fmt::print("{}\n", json.dump());
    return OkStatus();
  }
  fmt::print("{}: {} is {} for {:.0f} days\n  {}\n", options.out, identity.name, identity.role,
             identity.days(), identity.fingerprint);
  if (identity.role != "daemon") {
    fmt::print("Copy {} to the rig's TLS folder: then it may come in.\n",
               (fs::path(options.ca) / "allowed").string());
  }
  return OkStatus();
}

Status Revoke(const CertsOptions& options, const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const int removed, wire::RemoveFromList(options.list(), options.who));
  if (removed == 0) {
    return NotFound("{}: {} is not in it, by name or fingerprint", options.list().string(),
                    options.who);
  }
  if (common.json) {
    fmt::print("{}\n", nlohmann::json{{"revoked", removed}}.dump());
  } else {
    fmt::print("{}: {} taken out. A daemon that reads this file refuses them from now on.\n",
               options.list().string(), removed);
  }
  return OkStatus();
}

// Every certificate that was issued, and whether the list still has it.
Status List(const CertsOptions& options, const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const std::string issued,
                           ReadFile(fs::path(options.ca) / "issued", kMaxFile));
  MESORIG_ASSIGN_OR_RETURN(const std::string allowed, ReadFile(options.list(), kMaxFile));
  std::istringstream lines(issued);
  std::string fingerprint, name, role, end;
  std::tm parts{};
  const time_t now = Now();
  ::gmtime_r(&now, &parts);
  char today[32];
  std::strftime(today, sizeof(today), "%Y-%m-%dT%H:%MZ", &parts);
  nlohmann::json json = nlohmann::json::array();
  while (lines >> fingerprint >> name >> role >> end) {
    const char* state = end < today                                      ? "expired"
                        : role == "daemon"                               ? "in force"
                        : allowed.find(fingerprint) == std::string::npos ? "revoked"
                                                                         : "allowed";
    json.push_back({{"fingerprint", fingerprint},
                    {"name", name},
                    {"role", role},
                    {"end", end},
                    {"state", state}});
    if (!common.json) {
      fmt::print("{:<9} {:<14} {:<20} until {}  {}\n", state, role, name, end, fingerprint);
    }
  }
  if (common.json) fmt::print("{}\n", json.dump());
  return OkStatus();
}

Status MakeToken(const CertsOptions& options, const Common& common) {
  const fs::path dir = common.identity;
  MESORIG_ASSIGN_OR_RETURN(const std::string key, ReadFile(dir / "key.pem", kMaxFile));
  MESORIG_ASSIGN_OR_RETURN(const std::string certificate, ReadFile(dir / "cert.pem", kMaxFile));
  std::string gateway = options.gateway;
  if (fs::exists(gateway)) {
    MESORIG_ASSIGN_OR_RETURN(const std::string pem, ReadFile(gateway, kMaxFile));
    MESORIG_ASSIGN_OR_RETURN(const wire::Identity identity, wire::ReadIdentityPem(pem));
    gateway = identity.fingerprint;
  }
  MESORIG_ASSIGN_OR_RETURN(const std::string token,
                           wire::MakeToken(key, certificate, gateway, Now(), options.seconds));
  if (common.json) {
    fmt::print("{}\n", nlohmann::json{{"token", token}}.dump());
  } else {
    fmt::print("{}\n", token);
  }
  return OkStatus();
}

}  // namespace

std::vector<Command> AddCertsCommands(CLI::App& app, Common& common) {
  CLI::App* certs = app.add_subcommand("certs", "The laboratory's certificates, for --connect");
  certs->require_subcommand(1);
  certs->fallthrough();
  std::vector<Command> commands;
  const auto add = [&](const char* name, const char* help, auto run) {
    auto options = std::make_shared<CertsOptions>();
    CLI::App* sub = certs->add_subcommand(name, help);
    commands.push_back({sub, [options, run, &common] { return run(*options, common); }});
    return std::pair(sub, options);
  };
  const auto [init, i] = add("init", "Make a CA; its folder need not be on the rig", Init);
  init->add_option("folder", i->ca, "Folder of the CA")->required();
  init->add_option("--name", i->name, "Of the laboratory")->capture_default_str();
  const auto [issue, u] = add("issue", "A key and a certificate for somebody", Issue);
  issue->add_option("--ca", u->ca, "Folder of the CA")->required();
  issue
      ->add_option("--role", u->role,
                   "observer, processing, operator, administrator, gateway, daemon")
      ->required();
  issue->add_option("--name", u->name, "Of the person or program")->required();
  issue->add_option("--host", u->hosts, "Of a daemon: name or address that it is reached by");
  issue->add_option("--days", u->days, "Until it ends")->capture_default_str();
  issue->add_option("--out", u->out, "New folder for key.pem, cert.pem, ca.pem")->required();
  const auto [revoke, r] = add("revoke", "Take certificates off the list of those allowed", Revoke);
  revoke->add_option("who", r->who, "A fingerprint, or a name: all of that name")->required();
  auto* revoke_ca = revoke->add_option("--ca", r->ca, "Folder of the CA, for its list");
  auto* revoke_list = revoke->add_option("--allowed", r->allowed, "The list itself, on the rig");
  revoke_list->excludes(revoke_ca);
  const auto [list, l] = add("list", "What was issued, and what of it is allowed", List);
  list->add_option("--ca", l->ca, "Folder of the CA")->required();
  list->add_option("--allowed", l->allowed, "Another list than the CA's");
  const auto [token, t] =
      add("token", "What a gateway needs to act for the user of --identity", MakeToken);
  token->add_option("--gateway", t->gateway, "Its certificate's file, or fingerprint")->required();
  token->add_option("--seconds", t->seconds, "Until it ends")->capture_default_str();
  return commands;
}

}  // namespace mesorig::client
