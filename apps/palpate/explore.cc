#include "palpate/session/explore.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>

#include "apps/command/keys.h"
#include "apps/command/signals.h"
#include "explore_result.h"
#include "explore_status.h"
#include "grip_records.h"
#include "input_files.h"
#include "known_devices.h"
#include "page_server.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/device/rendered_stiffness.h"
#include "palpate/device/session_settings.h"
#include "palpate/server/viewer_server.h"
#include "palpate/server/viewer_tokens.h"
#include "palpate/tracker/tracker_driver.h"
#include "recorded_runs.h"
#include "scene_options.h"
#include "scoring.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct ExploreArguments {
  SceneSource source;
  std::optional<std::filesystem::path> script, recording, supervisor_log;
  std::optional<double> max_force_N, rate_hz, seconds;
  std::optional<std::uint64_t> seed;
  std::optional<ForceMethod> method;
  double spin_us = 0;
  int cpu = -1;
  std::vector<std::string> devices;
  DeviceOptions about_devices;
  DeviceRegistry known;
  std::shared_ptr<const Navigation> navigation;
  bool may_move = false, repeat = false, no_realtime = false, no_supervisor = false;
  bool no_viewer = false;
  ServingOptions serving;
  std::string task, learner;
  std::optional<std::filesystem::path> plan;
  std::filesystem::path records;
  bool stores_runs = false;  // whether runs are added to `records`
};

// claims the output files: the recording and the log of the supervisor
Result<std::vector<OutputClaim>> check_and_claim_outputs(const ExploreArguments& options) {
  if (auto possible = check_devices(options.devices, options.known); !possible) return possible.error();
  if (std::ranges::find(options.devices, kPointer) != options.devices.end() && options.no_viewer)
    return Error{ErrorKind::kUsage,
                 "the pointer is moved in the viewer, and --no-viewer turns the viewer off", "--device",
                 "leave out --no-viewer"};
  if (options.devices.front() == kRos2Hand && !options.serving.ros2)
    return Error{ErrorKind::kUsage, "a ROS 2 node moves the tip only in a session published to ROS 2",
                 "--device", "give --ros2 DOMAIN, too"};
  if (options.navigation && std::ranges::find(options.devices, kTracker) == options.devices.end())
    return Error{ErrorKind::kUsage, "the options of a tracked tool need a tracker", "--registration",
                 "give --device tracker"};
  if (options.devices.front() != kSimulatedHand && (options.script || options.repeat))
    return Error{ErrorKind::kUsage, "a script moves the simulated hand only",
                 options.script ? "--script" : "--repeat",
                 "leave it out, or make the simulated hand the first device: --device simulated"};
  const long cpus = ::sysconf(_SC_NPROCESSORS_CONF);
  if (options.cpu >= cpus)
    return Error{ErrorKind::kUsage, "this machine has no CPU " + std::to_string(options.cpu), "--cpu",
                 "choose one from 0 to " + std::to_string(cpus - 1)};
  if (options.plan && options.no_viewer)
    return Error{ErrorKind::kUsage, "a plan is shown in the page, and --no-viewer serves no page", "--plan",
                 "leave out one of the two; palpate plan compare compares a recording with a plan"};
  if (!options.no_viewer)
    if (const auto servable = ViewerServer::check(options.serving.viewers); !servable)
      return servable.error();
  if (options.supervisor_log && options.no_supervisor)
    return Error{ErrorKind::kUsage, "without a supervisor there is no log to write", "--supervisor-log",
                 "leave out --no-supervisor"};
  if (options.recording && options.supervisor_log && same_file(*options.recording, *options.supervisor_log))
    return Error{ErrorKind::kUsage, "is also the recording", "--supervisor-log", "choose another file"};
  std::vector<OutputClaim> claims;
  if (!options.recording && !options.supervisor_log) return claims;
  auto inputs = input_files(options.source);
  if (options.script) inputs.push_back(*options.script);
  if (options.plan) inputs.push_back(*options.plan);
  const ViewerServerOptions& viewers = options.serving.viewers;
  for (const auto& input : {viewers.token_file, viewers.tls_certificate, viewers.tls_key,
                            options.about_devices.stream.tip, options.about_devices.registration})
    if (!input.empty()) inputs.push_back(input);
  for (const auto& output : {options.recording, options.supervisor_log}) {
    if (!output) continue;
    auto claimed = claim_output(*output, inputs);
    if (!claimed) return claimed.error();
    claims.push_back(*std::move(claimed));
  }
  return claims;
}

// servers of a session, which end with it
struct Servers {
  std::unique_ptr<ViewerServer> viewers;
  Publishers publishers;
};

// function that starts the requested servers; empty without one
// @param address  set to the URL of the page
std::function<Result<std::shared_ptr<void>>(LiveHost&)> viewers_of(const ExploreArguments& options,
                                                                   Console& console, ViewerFaultQueue& faults,
                                                                   std::string& address) {
  if (options.no_viewer && !options.serving.publishes()) return {};
  return [&](LiveHost& host) -> Result<std::shared_ptr<void>> {
    auto servers = std::make_shared<Servers>();
    if (!options.no_viewer) {
      auto server = serve(host, options.serving, console, faults);
      if (!server) return server.error();
      address = (*server)->url();
      servers->viewers = *std::move(server);
    }
    auto published = publish(host, options.serving, console, faults);
    if (!published) return published.error();
    servers->publishers = *std::move(published);
    return std::shared_ptr<void>(std::move(servers));
  };
}

ExploreOptions session_of(const ExploreArguments& options, Keys& keys, ViewerFaultQueue& faults,
                          Console& console) {
  ExploreOptions session;
  session.run = {options.max_force_N, options.seed, options.rate_hz, options.method};
  session.loop.spin_s = options.spin_us * 1e-6;
  session.loop.realtime = !options.no_realtime;
  session.loop.cpu = options.cpu;
  session.loop.may_move = options.may_move;
  session.seconds = options.seconds;
  session.repeat = options.repeat;
  if (!options.no_supervisor) session.supervisor = {"/proc/self/exe", "supervise"};
  session.supervisor_log = options.supervisor_log.value_or("");
  // consent questions appear in the status line and are answered by a key
  session.has_operator = keys.active() && ::isatty(console.streams().err) == 1 && !console.quiet;
  session.request = [&keys, &faults, &console] {
    faults.show_next(console);
    switch (keys.next().value_or('\0')) {
      case ' ':
        return ExploreRequest::kEmergencyStop;
      case 'r':
        return ExploreRequest::kRearm;
      case 'y':
        return ExploreRequest::kAgree;
      case 'n':
        return ExploreRequest::kDecline;
      case 'p':
        return ExploreRequest::kPause;
      case 'm':
        return ExploreRequest::kNextMethod;
      case 'b':
        return ExploreRequest::kMotor;
      case 'u':
        return ExploreRequest::kUndoStroke;
      case 'd':
        return ExploreRequest::kRedoStroke;
      case 't':
        return ExploreRequest::kTask;
      default:
        return ExploreRequest::kNone;
    }
  };
  return session;
}

// "knee-phantom" of "knee-phantom:side=right"
std::string kind_of(const std::string& data_set) {
  return data_set.substr(0, data_set.find(':'));
}

Result<TrainingOptions> training_of(const ExploreArguments& options, const LoadedScene& loaded,
                                    Console& console) {
  TrainingOptions training;
  if (!options.task.empty()) {
    auto task = offered_task(options.task);
    if (!task) return task.error();
    const std::string& data_set = task->file.data_set;
    if (!data_set.empty() && kind_of(data_set) != kind_of(loaded.data_set))
      console.warn()("the task is made for " + printable_name(data_set) +
                     ", and the scene here is a different one");
    training.tasks.push_back(*std::move(task));
    training.requires_all_tasks = true;
    // a person starts the task when ready, from the page or by a key
    training.begins_with_first_tick = options.devices.front() == kSimulatedHand || options.no_viewer;
  } else if (!loaded.data_set.empty() && !options.no_viewer && !options.serving.publishes()) {
    // a published session has no tasks: a receiver would see what a task hides
    for (const EmbeddedFile& file : embedded_tasks()) {
      auto task = parse_task(file.text, std::string(file.name));
      PALPATE_CHECK(task.ok());
      if (kind_of(task->data_set) != kind_of(loaded.data_set)) continue;
      training.tasks.push_back({std::filesystem::path(file.name).stem().string(), *std::move(task)});
    }
  }
  training.learner = options.learner;
  if (!options.stores_runs) return training;
  training.store_run = [file = options.records](const TaskFile& task, const TaskRun& run) {
    auto stored = add_run_with_history(file, run.learner, task, {{}, *run.header, run.score, run.run_hash});
    if (stored) return *std::move(stored);
    RunHistory none;
    none.not_stored = stored.error();
    return none;
  };
  training.curves = [file = options.records](const std::string& learner) {
    return learners_page_html(file, learner);
  };
  return training;
}

// checks the records of all learners whose runs may be stored: the learner of the session, those with a
// learner's token, and those that a teacher selects
Result<void> check_learners(ExploreArguments& options, Console& console) {
  std::vector<std::string> learners;
  if (!options.learner.empty()) learners.push_back(options.learner);
  bool has_teacher = false;
  if (!options.serving.viewers.token_file.empty() && !options.no_viewer) {
    const auto holders = holders_of_tokens(options.serving.viewers.token_file);
    if (!holders) return holders.error();
    learners.insert(learners.end(), holders->learners.begin(), holders->learners.end());
    has_teacher = holders->teacher;
  }
  options.stores_runs = !learners.empty() || has_teacher;
  if (!options.records.empty() && !options.stores_runs)
    return Error{ErrorKind::kUsage, "there is no learner to store runs for", "--records",
                 "name a --learner, or a --token-file with learners or a teacher"};
  return options.stores_runs ? check_records(options.records, learners, console) : Result<void>();
}

int explore_target(ExploreArguments options, Console& console) {
  if (options.devices.empty()) options.devices = {kSimulatedHand};
  auto navigation = navigation_of(options.about_devices);
  if (!navigation) return console.fail(navigation.error());
  options.navigation = *std::move(navigation);
  auto known = known_devices(options.about_devices, options.navigation, options.devices);
  if (!known) return console.fail(known.error());
  options.known = *std::move(known);
  const auto claimed = check_and_claim_outputs(options);
  if (!claimed) return console.fail(claimed.error());
  if (const auto stored = check_learners(options, console); !stored) return console.fail(stored.error());
  const Progress progress = console.progress();
  const auto loaded = load_target(options.source, console);
  if (!loaded) return console.fail(loaded.error());
  // a scene without touchable tissue can still be viewed in the page
  const auto touchable = require_touchable_tissue(*loaded);
  if (!touchable && (options.script || options.no_viewer)) return console.fail(touchable.error());
  if (!touchable) console.note("the scene has no touchable tissue yet: it is only displayed in the page");
  if (!touchable) options.devices = {kPointer};
  const bool pointer = options.devices.front() == kPointer || options.devices.front() == kRos2Hand;
  const auto script = script_of(options.script);
  if (!script) return console.fail(script.error());
  note_rendered_stiffness(*loaded, console);
  std::shared_ptr<SharedPlan> plan;
  if (options.plan) {
    auto opened = SharedPlan::open(*options.plan, *loaded->model, true);
    if (!opened) return console.fail(opened.error());
    plan = *std::move(opened);
  }
  auto training = training_of(options, *loaded, console);
  if (!training) return console.fail(training.error());

  // a suspended process would leave the device at its last force
  const ScopedSignals unstoppable({SIGTSTP, SIGTTIN, SIGTTOU}, SIG_IGN);
  // if the terminal closes, the session continues without keys: the device must not be released for that
  const ScopedSignals without_terminal({SIGHUP}, SIG_IGN);
  std::optional<Keys> keys(std::in_place, console.streams().in);
  std::string address, printed_warnings;
  std::optional<ViewedNavigation> tracked;
  ViewerFaultQueue faults;
  ExploreOptions session = session_of(options, *keys, faults, console);
  session.devices = options.devices;
  session.training = *training;
  // task for which the session was started; from the tasks that a page offers any may be started
  if (training->requires_all_tasks)
    session.run.task = recorded_task(training->tasks.front(), loaded->data_set);
  session.plan = plan;
  session.navigation = options.navigation;
  const auto figures = stored_grip_figures();
  if (!figures) return console.fail(figures.error());
  session.known = with_grip_figures(options.known, *figures, options.rate_hz.value_or(Script{}.rate_hz));
  session.viewers = viewers_of(options, console, faults, address);
  const auto result =
      explore(*loaded, *script, session, options.recording.value_or(""), progress,
              explore_status_printer(!options.no_realtime, address, printed_warnings, tracked, console));
  keys.reset();
  console.show_status("");
  if (!result) return console.fail(result.error());
  if (result->stopped_by_user) console.note("stopped");
  if (plan && !plan->viewed()->saved)
    console.warn()(options.plan->string() +
                   ": changes to the plan made in the page were not saved and are lost");
  warn_of_problems(result->problems, printed_warnings, console);
  print_explore_result(*result, pointer);
  if (tracked) print_tip_error(*tracked);
  print_runs(result->runs, *training);
  if (result->recording_failure) return console.fail(*result->recording_failure);
  if (result->device_lost)
    return console.fail({ErrorKind::kUnavailable, "the driver of the device has failed", "",
                         "check its connection and power; the recording up to then is kept"});
  if (options.recording) console.note("recording: " + options.recording->string());
  // a session that the user ends is a success, because the user has seen its outcome
  const bool in_band =
      options.task.empty() || (!result->runs.empty() && result->runs.back().run.score.in_band);
  return (result->failed_steps == 0 && in_band) || result->stopped_by_user ? kExitOk : kExitLimit;
}

void add_options(CLI::App* verb, ExploreArguments& options) {
  add_source_options(*verb, options.source)->required();
  verb->add_option("-s,--script", options.script,
                   "Palpation script (TOML); default: one planned for the scene");
  verb->add_option(
          "--device", options.devices,
          "Device that moves the tip: simulated (a hand that follows the script), pointer (moved by a "
          "viewer in the page), ros2 (moved by a node, with --ros2), the name of a device (palpate "
          "devices), or plugin=FILE (your own driver, docs/guide/plug-ins.md); may be repeated, up to "
          "4 devices; default: simulated")
      ->allow_extra_args(false);
  add_device_options(*verb, options.about_devices);
  add_stream_options(*verb, options.about_devices.stream);
  add_tip_option(*verb, options.about_devices.stream);
  verb->add_option("--registration", options.about_devices.registration,
                   "Registration of the patient for a tracked tool, as written by palpate register -o");
  verb->add_flag(
      "--may-move", options.may_move,
      "Allow an arm to move by itself during initialisation: confirm that nobody is within its reach");
  verb->add_option("-o,--output", options.recording, "Recording to write (HDF5)");
  verb->add_option(
      "-t,--task", options.task,
      "Task to train, scored live: a file or the name of a task (palpate task "
      "list); default: the page offers the tasks made for the scene, unless the session is published "
      "by OpenIGTLink or to ROS 2");
  verb->add_option("--learner", options.learner, "Pseudonym of the learner whose runs are recorded")
      ->check(CLI::Validator(
          [](const std::string& name) { return name.empty() ? "the pseudonym must not be empty" : ""; }, ""));
  verb->add_option("--records", options.records, "File of training records (palpate records --help)");
  verb->add_option("--plan", options.plan,
                   "Plan to rehearse (palpate plan --help), shown and edited in the page; a file that does "
                   "not exist starts as an empty plan");
  verb->add_option("--max-force", options.max_force_N,
                   "Force limit in N, in addition to the device's own; default: the lesser of its continuous "
                   "rating and 3 N")
      ->check(number_between(kMaxForceRange.min, kMaxForceRange.max));
  verb->add_option("--rate", options.rate_hz, "Servo rate in Hz; default: the script's")
      ->check(number_between(kMinRate_hz, kMaxRate_hz));
  verb->add_option(
          "--spin", options.spin_us,
          "Busy-wait this many microseconds before every tick, up to 0.8 of a period; default: 0 (sleep)")
      ->check(number_between(0, 1000));
  verb->add_option("--seconds", options.seconds,
                   "Duration of the session in seconds; default: until the script ends")
      ->check(number_between(0.1, 86400));
  verb->add_flag("--repeat", options.repeat, "Repeat the script until the session is stopped");
  verb->add_option("--seed", options.seed, "Seed of the hand's tremor; default: the script's")
      ->check(whole_between(0, 9007199254740991));
  add_method_option(*verb, "Initial force method; default: the scene's", kForceMethods, options.method);
  verb->add_flag("--no-viewer", options.no_viewer, "Do not serve the viewer's page");
  add_serving_options(*verb, options.serving);
  verb->add_option("--cpu", options.cpu, "CPU to pin the servo thread to; default: any")
      ->check(whole_between(0, 4095));
  verb->add_flag("--no-realtime", options.no_realtime,
                 "Do not request real-time scheduling or locked memory");
  verb->add_flag("--no-supervisor", options.no_supervisor,
                 "Do not start the supervisor process that monitors this one");
  verb->add_option("--supervisor-log", options.supervisor_log,
                   "File to append the supervisor's events to, one JSON object per line");
}

}  // namespace

void add_explore(CLI::App& app, Run& run) {
  auto options = std::make_shared<ExploreArguments>();
  CLI::App* verb = app.add_subcommand(
      "explore", "Palpate a scene in real time with a simulated hand, a pointer or a device");
  add_options(verb, *options);
  verb->footer(
      "Examples:\n"
      "  palpate explore knee-phantom --seconds 10\n"
      "  palpate explore knee-atlas -o run.h5 --rate 4000 --spin 100\n"
      "  palpate explore scene.toml --script press.toml --repeat\n"
      "  palpate explore STUDY seg.dcm --device pointer      a folder of DICOM and its segmentation\n"
      "  palpate explore knee-phantom --device pointer\n"
      "  palpate explore knee-phantom --device pointer --task hold-steady --learner L042\n"
      "  palpate explore scene.toml --device simulated --device pointer\n"
      "  palpate explore scene.toml --device tracker --tracker localhost:18944 --transform StylusToTracker\n"
      "    --reference ReferenceToTracker --tip tip.json --registration registration.json\n\n"
      "The session can be viewed in any browser, at the address printed when the loop starts\n"
      "(docs/guide/viewer.md).\n"
      "On a terminal, a status line is updated ten times a second: time, servo rate, lateness in the last\n"
      "second (median/99th percentile/maximum), force and its limit, and the structure touched.\n"
      "Keys: space is the emergency stop and never anything else; r rearms the force while the tip touches\n"
      "nothing (for a pointer: Rearm in the page); p pauses and resumes; m selects the next force method\n"
      "(docs/concepts/methods.md). With a burr, b switches the motor, u undoes the last stroke and d redoes\n"
      "it (docs/guide/burr.md). t starts and ends a run of a task (docs/tutorials/training.md); with a\n"
      "simulated hand the run starts with the session. While a force-feedback device is stopped, a\n"
      "six-digit code is shown with which it can be rearmed once from the page. While a device can apply\n"
      "force, a viewer's request for a change is shown instead of the status line: y accepts, n declines.\n"
      "Ctrl-C (SIGINT) or SIGTERM is the usual end of an open session: the force fades out, the\n"
      "recording is finished, the figures are printed, and the exit code is 0. A second signal ends the\n"
      "program at once. Ctrl-Z is ignored, because a device would keep its last force.\n"
      "A full disk ends the recording, not the session; the exit code is then 4.\n"
      "docs/guide/explore.md: real-time privileges, and how to read the figures.\n"
      "\n" +
      hold_definition() + " The exit code is\nthen 3, unless the user ended the session.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return explore_target(*options, console); }; });
}

}  // namespace palpate::app
