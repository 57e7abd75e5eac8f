// lease, jog, axis, lamp, laser: the rig by hand.

#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <functional>
#include <memory>
#include <thread>

#include "client/cli/commands.h"
#include "client/cli/held_lease.h"
#include "client/cli/text.h"
#include "client/connection/daemon_client.h"
#include "protocol/base/geometry.h"

namespace mesorig::client {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kLook{50};
// A terminal repeats a key that is held, the first time after a while.
constexpr std::chrono::milliseconds kFirstRepeat{600}, kNextRepeat{150};

struct HandOptions {
  uint64_t token = 0;
  std::string name;
  double value = 0, seconds = 0;
  bool take = false, home = false;
};

void AddToken(CLI::App& command, HandOptions& options) {
  command
      .add_option("--lease", options.token,
                  "Token of a lease that `mesorig lease take` holds; without it one is taken for "
                  "this command, and everything is off when it ends")
      ->envname("MESORIG_LEASE");
}

Status PrintLease(const Common& common, const v1::LeaseStatus& lease) {
  fmt::print("{}\n", common.json ? JsonText(lease) : LeaseText(lease));
  return OkStatus();
}

// Holds the lease until Ctrl-C, and tells who asks for it.
Status Hold(const Common& common, const HandOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
  InstallInterrupt();
  MESORIG_ASSIGN_OR_RETURN(const auto held,
                           HeldLease::Take(*daemon, 0, options.seconds, options.take));
  fmt::print("lease {}: yours until Ctrl-C; other commands: --lease {}\n", held->token(),
             held->token());
  std::fflush(stdout);
  std::string asked;
  auto due = HostClock::now();
  while (!Interrupted() && !held->lost()) {
    std::this_thread::sleep_for(kLook);
    if (HostClock::now() < due) continue;
    due = HostClock::now() + std::chrono::seconds(1);
    const auto status = daemon->GetStatus();
    if (!status.ok() || status->lease().requested_by() == asked) continue;
    asked = status->lease().requested_by();
    if (asked.empty()) continue;
    fmt::print("{} asks for control of the rig: Ctrl-C gives it up\n", asked);
    std::fflush(stdout);
  }
  return held->lost() ? FailedPrecondition("lease {} is over", held->token()) : OkStatus();
}

// A key is held down, or `seconds` have not passed; nobody pressed Ctrl-C.
class Holding {
 public:
  explicit Holding(double seconds)
      : until_(HostClock::now() + std::chrono::milliseconds(static_cast<int64_t>(seconds * 1000))),
        by_key_(seconds <= 0 && ::isatty(STDIN_FILENO) == 1) {
    if (!by_key_ || ::tcgetattr(STDIN_FILENO, &before_) != 0) return;
    termios raw = before_;
    raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    ::tcsetattr(STDIN_FILENO, TCSANOW, &raw);
    changed_ = true;
    fmt::print(stderr, "Hold a key to run, let go to stop; q ends.\n");
    char key = 0;
    while (!Interrupted() && !Pressed(1000, key)) {
    }
    ended_ = Interrupted() || key == 'q';
    until_ = HostClock::now() + kFirstRepeat;
  }
  ~Holding() {
    if (changed_) ::tcsetattr(STDIN_FILENO, TCSANOW, &before_);
  }
  bool by_key() const { return by_key_; }
  bool operator()() {
    char key = 0;
    if (by_key_ && Pressed(0, key)) {
      ended_ = ended_ || key == 'q';
      until_ = HostClock::now() + kNextRepeat;
    }
    return !ended_ && !Interrupted() && HostClock::now() < until_;
  }

 private:
  static bool Pressed(int wait_ms, char& key) {
    pollfd keys{STDIN_FILENO, POLLIN, 0};
    return ::poll(&keys, 1, wait_ms) > 0 && ::read(STDIN_FILENO, &key, 1) == 1;
  }
  HostClock::time_point until_;
  const bool by_key_;
  bool changed_ = false, ended_ = false;
  termios before_{};
};

// One command of the rig with a lease, its own or one that is held elsewhere.
Status WithLease(const Common& common, const HandOptions& options,
                 const std::function<Status(DaemonClient&, HeldLease&)>& give) {
  MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
  InstallInterrupt();
  MESORIG_ASSIGN_OR_RETURN(const auto held, HeldLease::Take(*daemon, options.token));
  return give(*daemon, *held);
}

Status Jog(const Common& common, const HandOptions& options) {
  if (options.seconds <= 0 && ::isatty(STDIN_FILENO) != 1) {
    return InvalidArgument("jog: without a terminal --for SECONDS says how long");
  }
  return WithLease(common, options, [&](DaemonClient& daemon, HeldLease& held) {
    Holding holding(options.seconds);
    return daemon.Jog(held.token(), options.name, RadFromDeg(options.value),
                      [&] { return !held.lost() && holding(); });
  });
}

Status MoveAxis(const Common& common, const HandOptions& options, bool has_target) {
  if (has_target == options.home) {
    return InvalidArgument("axis {}: either --to DEGREES or --home", options.name);
  }
  return WithLease(common, options, [&](DaemonClient& daemon, HeldLease& held) {
    const auto leave = [&] { return Interrupted() || held.lost(); };
    return options.home
               ? daemon.HomeAxis(held.token(), options.name, leave)
               : daemon.MoveAxis(held.token(), options.name, RadFromDeg(options.value), leave);
  });
}

Status SwitchLamp(const Common& common, const HandOptions& options) {
  const bool off = options.name == "off";
  return WithLease(common, options, [&](DaemonClient& daemon, HeldLease& held) -> Status {
    MESORIG_RETURN_IF_ERROR(daemon.SetLamp(held.token(), off ? "" : options.name));
    if (off || !held.own()) return OkStatus();
    const auto end =
        HostClock::now() + std::chrono::milliseconds(static_cast<int64_t>(options.seconds * 1000));
    while (!Interrupted() && !held.lost() && HostClock::now() < end) {
      std::this_thread::sleep_for(kLook);
    }
    return OkStatus();
  });
}

std::vector<Command> AddLease(CLI::App& app, Common& common) {
  CLI::App* lease = app.add_subcommand("lease", "Control of the rig by hand: one at a time");
  lease->require_subcommand(1);
  lease->fallthrough();
  auto options = std::make_shared<HandOptions>();
  CLI::App* take = lease->add_subcommand("take", "Take it, and hold it until Ctrl-C");
  take->add_option("--span", options->seconds, "It ends so long after the last renewal, 1 to 60 s")
      ->default_str("10");
  take->add_flag("--take", options->take,
                 "End a lease that is held: your own elsewhere; an administrator anybody's");
  auto token = std::make_shared<uint64_t>(0);
  CLI::App* release = lease->add_subcommand("release", "Give it up: everything by hand goes off");
  release->add_option("token", *token, "Of `mesorig lease take`")
      ->required()
      ->envname("MESORIG_LEASE");
  CLI::App* status = lease->add_subcommand("status", "Who has it");
  CLI::App* request = lease->add_subcommand("request", "Ask whoever has it to give it up");
  return {{take, [&common, options] { return Hold(common, *options); }},
          {release,
           [&common, token]() -> Status {
             MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
             MESORIG_ASSIGN_OR_RETURN(const auto left, daemon->ReleaseLease(*token));
             return PrintLease(common, left);
           }},
          {status,
           [&common]() -> Status {
             MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
             MESORIG_ASSIGN_OR_RETURN(const auto reply, daemon->GetStatus());
             return PrintLease(common, reply.lease());
           }},
          {request, [&common]() -> Status {
             MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
             MESORIG_ASSIGN_OR_RETURN(const auto asked, daemon->RequestHandover());
             return PrintLease(common, asked);
           }}};
}

}  // namespace

std::vector<Command> AddHandCommands(CLI::App& app, Common& common) {
  std::vector<Command> commands = AddLease(app, common);
  const auto add = [&](const char* name, const char* help) {
    auto options = std::make_shared<HandOptions>();
    CLI::App* command = app.add_subcommand(name, help);
    AddToken(*command, *options);
    return std::pair(command, options);
  };

  auto [jog, jogged] = add("jog", "Run an axis while a key is held, or --for SECONDS");
  jog->add_option("axis", jogged->name, "Its name in the rig file")->required();
  jog->add_option("--rate", jogged->value, "Degrees a second, signed: --rate=-5")->required();
  jog->add_option("--for", jogged->seconds, "Instead of a key");
  commands.push_back({jog, [&common, o = jogged] { return Jog(common, *o); }});

  auto [axis, moved] = add("axis", "Move an axis to an angle, or search its reference");
  axis->add_option("axis", moved->name, "Its name in the rig file")->required();
  CLI::Option* to = axis->add_option("--to", moved->value, "Degrees");
  axis->add_flag("--home", moved->home, "Search the reference");
  commands.push_back(
      {axis, [&common, o = moved, to] { return MoveAxis(common, *o, to->count() > 0); }});

  auto [lamp, lit] = add("lamp", "Let one lamp shine, or none");
  lit->seconds = 5;
  lamp->add_option("lamp", lit->name, "Its name in the rig file, or off")->required();
  lamp->add_option("--for", lit->seconds, "Seconds, without --lease")->capture_default_str();
  commands.push_back({lamp, [&common, o = lit] { return SwitchLamp(common, *o); }});

  auto [laser, shone] = add("laser", "Let the laser shine for a moment");
  shone->seconds = 2;
  laser->add_option("--for", shone->seconds, "Seconds, at most 10")->capture_default_str();
  commands.push_back({laser, [&common, o = shone] {
                        return WithLease(common, *o, [&](DaemonClient& daemon, HeldLease& held) {
                          return daemon.TestLaser(held.token(), o->seconds,
                                                  [&] { return Interrupted() || held.lost(); });
                        });
                      }});
  return commands;
}

}  // namespace mesorig::client
