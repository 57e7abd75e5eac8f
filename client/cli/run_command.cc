#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <nlohmann/json.hpp>

#include "client/cli/commands.h"
#include "client/cli/text.h"
#include "client/connection/daemon_client.h"
#include "client/connection/processing_client.h"
#include "protocol/base/file_writer.h"

namespace mesorig::client {
namespace {

constexpr size_t kMaxPlan = 4u << 20;

struct RunOptions {
  std::string plan;
  std::string on_prompt;
  bool no_wait = false, no_products = false;
  uint64_t lease = 0;
};

// Lets a command, or the operator at this terminal, do what a prompt asks for; then acknowledges.
Status AnswerPrompt(const RunOptions& options, DaemonClient& daemon, const v1::Prompt& prompt) {
  fmt::print(stderr, "{}\n", PromptText(prompt));
  if (!options.on_prompt.empty()) {
    ::setenv("MESORIG_PROMPT_ID", std::to_string(prompt.id()).c_str(), 1);
    ::setenv("MESORIG_PROMPT_TEXT", prompt.text().c_str(), 1);
    ::setenv("MESORIG_PROMPT_MOUNT", prompt.mount().c_str(), 1);
    if (const int code = std::system(options.on_prompt.c_str()); code != 0) {
      return FailedPrecondition("--on-prompt {}: ended with status {}; the plan waits on",
                                options.on_prompt, code);
    }
  } else if (::isatty(STDIN_FILENO) == 1) {
    fmt::print(stderr, "Press Enter when it is done.\n");
    std::string line;
    std::getline(std::cin, line);
  } else {
    return OkStatus();  // somebody acknowledges from another console
  }
  const Status acknowledged = daemon.Acknowledge(prompt.id());
  if (!acknowledged.ok()) fmt::print(stderr, "mesorig: {}\n", Message(acknowledged));
  return OkStatus();
}

// Ctrl-C leaves the plan running: a closed laptop does not end the night.
void Detach(int) {
  constexpr char kText[] =
      "\nmesorig: detached; the plan goes on. `mesorig status` looks, `mesorig stop` stops it.\n";
  [[maybe_unused]] const ssize_t n = ::write(STDERR_FILENO, kText, sizeof(kText) - 1);
  ::_exit(130);
}

// Watches until this session ends.
StatusOr<v1::SessionEnded> AwaitEnd(const RunOptions& options, DaemonClient& daemon,
                                    const v1::RunReply& reply) {
  ProgressBar bar;
  v1::SessionEnded ended;
  Status answered;
  bool seen = false;
  MESORIG_RETURN_IF_ERROR(daemon.Watch(reply.event_sequence(), [&](const v1::Event& event) {
    if (event.has_gap() && event.gap().other_life()) {
      answered = Unavailable("mesorigd began anew: session {} was killed (`mesorig resume`)",
                             reply.session_id());
      return false;
    }
    if (event.has_progress() && event.progress().session_id() == reply.session_id()) {
      bar.Show(event.progress().shots_done(), reply.shots(), "shots");
    }
    if (event.has_prompt()) {
      answered = AnswerPrompt(options, daemon, event.prompt());
      if (!answered.ok()) return false;
    }
    // What somebody should know while there is time to act.
    const bool notable = event.has_alarm() || event.has_note() ||
                         (event.has_state() && event.state().state() == v1::PAUSED);
    if (notable) fmt::print(stderr, "{}\n", EventText(event));
    if (event.has_ended() && event.ended().session_id() == reply.session_id()) {
      ended = event.ended();
      seen = true;
    }
    return !seen;
  }));
  MESORIG_RETURN_IF_ERROR(answered);
  return ended;
}

nlohmann::json ToJson(const v1::RunReply& reply, const v1::SessionEnded& ended,
                      const v1::ProductsReply& products) {
  nlohmann::json files = nlohmann::json::array();
  for (const auto& product : products.products()) {
    files.push_back(
        {{"kind", product.kind()}, {"path", product.path()}, {"bytes", product.bytes()}});
  }
  return {{"session_id", reply.session_id()},
          {"complete", ended.complete()},
          {"frames_planned", reply.frames()},
          {"frames_on_disk", ended.frames_durable()},
          {"frames_blocked", reply.frames_blocked()},
          {"frame_bytes", reply.frame_bytes()},
          {"shots", reply.shots()},
          {"sweeps", reply.sweeps()},
          {"prompts", reply.prompts()},
          {"estimated_s", reply.estimated_s()},
          {"virtual_s", ended.virtual_s()},
          {"wall_s", ended.wall_s()},
          {"preparation_s", ended.preparation_s()},
          {"deterministic", ended.deterministic()},
          {"processing_s", products.processing_s()},
          {"processing_wall_s", products.wall_s()},
          {"products", files}};
}

StatusOr<v1::ProductsReply> Products(const Common& common, const std::string& session_id) {
  if (!common.connect.empty()) {  // mesorig-processd answers on its own machine only
    fmt::print(stderr, "mesorig: the products are told on the rig's machine, not over --connect\n");
    return v1::ProductsReply();
  }
  auto processing = ProcessingClient::Connect(common.runtime_dir);
  if (!processing.ok()) {  // capture without a processing service is a way to work
    fmt::print(stderr, "mesorig: no products: {}\n", Message(processing.status()));
    return v1::ProductsReply();
  }
  MESORIG_ASSIGN_OR_RETURN(v1::ProductsReply products, (*processing)->AwaitProducts(session_id));
  if (!products.error().empty()) return Internal("processing failed: {}", products.error());
  return products;
}

void PrintBegun(const v1::RunReply& reply) {
  fmt::print("session {}: {} shots, {} frames, {}, about {} at the rig\n", reply.session_id(),
             reply.shots(), reply.frames(), BytesText(reply.frame_bytes()),
             DurationText(reply.estimated_s()));
  if (reply.frames_missing() != reply.frames()) {
    fmt::print("{} frames are still to be taken, {}\n", reply.frames_missing(),
               BytesText(reply.missing_bytes()));
  }
  if (reply.frames_blocked() > 0) {
    fmt::print("{} frames are left out: solids block their beams\n", reply.frames_blocked());
  }
  if (reply.sweeps() > 0 || reply.prompts() > 0) {
    fmt::print("{} sweeps of the laser; the operator is asked {} times\n", reply.sweeps(),
               reply.prompts());
  }
  std::fflush(stdout);
}

// What run and resume have in common once the session is begun.
Status Follow(const RunOptions& options, const Common& common, DaemonClient& daemon,
              const v1::RunReply& reply) {
  if (!common.json) PrintBegun(reply);
  if (!reply.warning().empty()) fmt::print(stderr, "mesorig: {}\n", reply.warning());
  if (options.no_wait) {
    if (common.json) fmt::print("{}\n", JsonText(reply));
    return OkStatus();
  }
  std::signal(SIGINT, Detach);
  MESORIG_ASSIGN_OR_RETURN(const v1::SessionEnded ended, AwaitEnd(options, daemon, reply));
  if (!ended.complete()) {
    return absl::AbortedError(fmt::format("session {} is incomplete: {} ({} of {} frames durable)",
                                          reply.session_id(), ended.reason(),
                                          ended.frames_durable(), reply.frames()));
  }
  if (!common.json) {
    fmt::print("complete: {} of {} frames on disk, {} at the rig, {} here\n",
               ended.frames_durable(), reply.frames(), DurationText(ended.virtual_s()),
               DurationText(ended.wall_s()));
    std::fflush(stdout);
  }
  v1::ProductsReply products;
  if (!options.no_products) {
    MESORIG_ASSIGN_OR_RETURN(products, Products(common, reply.session_id()));
  }
  if (common.json) {
    fmt::print("{}\n", ToJson(reply, ended, products).dump());
    return OkStatus();
  }
  for (const auto& product : products.products()) {
    fmt::print("{}: {} ({})\n", product.kind(), product.path(), BytesText(product.bytes()));
  }
  return OkStatus();
}

void AddLeaseOption(CLI::App& command, RunOptions& options) {
  command
      .add_option("--lease", options.lease,
                  "Token of your lease, when you have one: the plan ends it and holds its own")
      ->envname("MESORIG_LEASE");
}

void AddFollowOptions(CLI::App& command, RunOptions& options) {
  AddLeaseOption(command, options);
  command.add_option("--on-prompt", options.on_prompt,
                     "Shell command that does what a prompt asks for (MESORIG_PROMPT_ID, _TEXT, "
                     "_MOUNT in its environment); when it ends with 0 the prompt is acknowledged");
  command.add_flag("--no-wait", options.no_wait, "Return once the session is journaled");
  command.add_flag("--no-products", options.no_products, "Do not wait for the processing service");
}

}  // namespace

Command AddRunCommand(CLI::App& app, Common& common) {
  auto options = std::make_shared<RunOptions>();  // lives as long as the parsed command
  CLI::App* run = app.add_subcommand(
      "run", "Run a plan and wait for its end and its products; Ctrl-C detaches");
  run->add_option("plan", options->plan, "Plan file (plans/*.toml)")->required();
  AddFollowOptions(*run, *options);
  return {run, [options, &common]() -> Status {
            MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(options->plan, kMaxPlan));
            MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
            MESORIG_ASSIGN_OR_RETURN(const v1::RunReply reply,
                                     daemon->Run(text, options->plan, options->lease));
            return Follow(*options, common, *daemon, reply);
          }};
}

Command AddArmCommand(CLI::App& app, Common& common) {
  auto options = std::make_shared<RunOptions>();
  options->no_wait = true;
  CLI::App* arm = app.add_subcommand(
      "arm",
      "Check a plan against rig, chain and disk and journal its session; nothing moves "
      "until `mesorig start`");
  arm->add_option("plan", options->plan, "Plan file (plans/*.toml)")->required();
  AddLeaseOption(*arm, *options);
  return {arm, [options, &common]() -> Status {
            MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(options->plan, kMaxPlan));
            MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
            MESORIG_ASSIGN_OR_RETURN(const v1::RunReply reply,
                                     daemon->Arm(text, options->plan, options->lease));
            return Follow(*options, common, *daemon, reply);
          }};
}

Command AddResumeCommand(CLI::App& app, Common& common) {
  struct Options {
    RunOptions run;
    std::string session, sample, reshoot;
    bool accept_reference = false;
  };
  auto options = std::make_shared<Options>();
  CLI::App* resume = app.add_subcommand(
      "resume",
      "Go on with a session that was killed, stopped, aborted or failed: what is missing "
      "is taken");
  resume->add_option("session", options->session, "Its id (`mesorig sessions`)")->required();
  resume
      ->add_option("--sample", options->sample,
                   "The name of the sample that lies on the rig: must be the session's")
      ->required();
  resume->add_option("--reshoot", options->reshoot,
                     "Frames to take again though they are there, as `shots 10-20, camera cam3`");
  resume->add_flag("--accept-reference", options->accept_reference,
                   "Go on though the reference frame differs from the one on the disk");
  AddFollowOptions(*resume, options->run);
  return {resume, [options, &common]() -> Status {
            MESORIG_ASSIGN_OR_RETURN(const auto daemon, DaemonClient::Connect(common.daemon()));
            v1::ResumeSessionRequest request;
            request.set_session_id(options->session);
            request.set_sample_name(options->sample);
            request.set_reshoot(options->reshoot);
            request.set_accept_reference(options->accept_reference);
            request.set_lease_token(options->run.lease);
            MESORIG_ASSIGN_OR_RETURN(const v1::RunReply reply, daemon->ResumeSession(request));
            return Follow(options->run, common, *daemon, reply);
          }};
}

}  // namespace mesorig::client
