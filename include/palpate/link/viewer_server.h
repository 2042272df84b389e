#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/device/telemetry.h"
#include "palpate/link/viewed_plan.h"
#include "palpate/link/viewed_training.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// What viewers on this machine or another see of a session and ask of it: HTTP and WebSocket, as
/// docs/reference/viewer-protocol.md says. The server knows neither the servo nor the model: a ViewerHost
/// tells it what there is and does what is asked.
namespace palpate {

/// The port of a viewer's page where none is asked for.
inline constexpr int kViewerPort = 8480;

/// What a viewer shows, the same as long as the session runs. Names of structures and tissues are in it,
/// nothing else of the patient's.
struct ViewedTissue {
  std::string name;
  bool felt = true;
  Rgb colour;
  double opacity = 1;
  std::vector<int> rests_on;
  std::string protection = "none";  ///< from a burr; or alarm, keep
};
struct ViewedStructure {
  LabelId label = 0;
  std::string name;
  Rgb colour;
  int tissue = -1;              ///< -1: of none
  std::vector<LabelId> within;  ///< Model::enclosing_of
};
/// A limitation of the model.
struct ViewedCaveat {
  std::string concerns;  ///< "placement", "side", "force"
  std::string text;      ///< Caveat::text
};
/// A recording, as a time line shows it. Times are the recording's own.
struct ViewedRecording {
  std::uint64_t ticks = 0;
  double begin_s = 0, end_s = 0;  ///< of the first and the last tick
  struct Contact {
    double begin_s = 0, end_s = 0;
    LabelId label = 0;
    double most_N = 0;  ///< greatest force meanwhile
    int device = 0;     ///< which of the recording's touched
  };
  std::vector<Contact> contacts;        ///< of all devices, by their begin
  std::uint64_t contacts_left_out = 0;  ///< the shortest, where there are too many to be shown
  struct Event {
    double time_s = 0;
    std::string kind;  ///< "stop", "rearm", "settings", "model"
    std::vector<std::string>
        changed;               ///< of "settings": what, by the keys of a SettingsRequest, or "pointer"
    int tissue = -1;           ///< of "model": which has changed, or -1 where the fields were made anew
    std::string by;            ///< "viewer", "key", "script", "session"
    std::uint32_t viewer = 0;  ///< its number, where a viewer asked
  };
  std::vector<Event> events;
  /// Of events: where there are too many to be shown, and those that no tick heard of.
  std::uint64_t events_left_out = 0;
  std::vector<double> force_N;  ///< greatest force of any device in each of equally many ticks
};

/// What a device holds.
struct ViewedTool {
  std::string name;
  double radius_mm = 0;
  bool cuts = false;  ///< it has a motor
  std::string burr;   ///< the shape of its head: "ball", "cylinder", "cone"; empty: it is no burr
  std::vector<std::array<double, 3>> points_mm;
  struct Capsule {
    std::array<double, 3> from_mm, to_mm;     ///< ends of its axis, in the tip's frame
    double radius_mm = 0, end_radius_mm = 0;  ///< where it begins and ends; between them it changes evenly
  };
  std::vector<Capsule> capsules;  ///< the head of a burr that is no ball is one
  bool shaver = false;            ///< what cuts is called a shaver, and not a burr
};

/// A region that the tool is to keep out of.
struct ViewedNoGo {
  struct Plane {
    std::array<double, 3> point_mm{}, outward{};  ///< patient; unit, towards where the tool may be
  };
  struct Ball {
    std::array<double, 3> centre_mm{};  ///< patient
    double radius_mm = 0;
  };
  std::string name;
  double keep_away_mm = 0;                   ///< so far before it the force begins
  std::variant<LabelId, Plane, Ball> place;  ///< a structure, all that lies behind a plane, or a ball
};

struct ViewedScene {
  std::string side = "unknown";  ///< "left", "right", "both", "unknown"
  bool oriented = true;
  std::vector<ViewedCaveat> caveats;
  std::string modality = "unknown";               ///< "ct", "mr", "unknown"
  std::uint64_t content_hash = 0;                 ///< of scan and labels: other voxels, another hash
  std::shared_ptr<const Volume<float>> scan;      ///< may be null
  std::shared_ptr<const Bricks<LabelId>> labels;  ///< never null
  std::array<double, 2> window{0, 1};             ///< in which to show the scan at first
  /// Row by row, mm.
  std::array<std::array<double, 4>, 4> world_from_patient{};
  std::vector<ViewedStructure> structures;
  std::vector<ViewedTissue> tissues;
  std::vector<ViewedTool> tools;     ///< of each device, never none
  std::vector<std::string> methods;  ///< that can be chosen
  std::vector<std::string> laws;     ///< of soft tissue, that can be chosen; none where nothing is soft
  std::string device_name;
  bool simulated = true;
  std::string input = "script";  ///< who moves the tip: "script", "pointer", "device", "recording"
  double peak_force_N = kNotKnown, continuous_force_N = kNotKnown, most_stiffness_N_per_mm = kNotKnown;
  double least_max_force_N = 0, most_max_force_N = 0;
  std::array<double, 2> stiffness_N_per_mm{}, friction{};
  double rate_hz = 1000;
  std::optional<ViewedRecording> recording;  ///< that is looked at, where no session runs
  std::vector<ViewedTask> tasks;             ///< that may be begun
  /// Of structures so near to a tool ticks tell the distance; empty: of none.
  std::optional<double> told_reach_mm;
  std::vector<ViewedNoGo> no_go;  ///< in the order that DeviceTick::no_go counts

  /// Whether ticks say anything of what is near and what keeps away.
  bool tells_near() const { return told_reach_mm.has_value() || !no_go.empty(); }
};

/// How wrong the place may be at which a tracked tool's tip is shown.
struct ViewedNavigation {
  int device = 0;       ///< whose tip
  bool is_seen = true;  ///< else the tip is where it was when the tracker saw it last
  double fre_mm = 0;    ///< of the registration's points
  struct Error {
    double rms_mm = 0, most_mm = 0;  ///< root of the mean square, and what 95 of 100 are below
    bool is_far = false;             ///< far outside the points that were touched
  };
  std::optional<Error> tip;  ///< empty: nothing is known of it
};

/// How the loop has kept time in the last second, and what it missed since it began.
struct ViewedHealth {
  double rate_hz = 0;
  double lateness_p50_us = 0, lateness_p99_us = 0, lateness_max_us = 0, compute_p50_us = 0;
  std::uint64_t skipped = 0, dropped = 0, stalls = 0;
};

/// What may change while the session runs.
struct ViewedTissueState {
  double stiffness_N_per_mm = 0;
  double static_friction = 0, dynamic_friction = 0;
  double viscosity_N_s_per_mm = 0;
};
/// Who stopped the force.
enum class StoppedBy : std::uint8_t {
  kSession,  ///< nobody: the session by itself, where nothing watched over it
  kKey,      ///< a key where palpate runs
  kViewer,
};
struct ViewedState {
  std::string method;
  std::string method_awaited;  ///< that is felt as soon as its fields are made; empty: none
  /// Why the method that was asked for last could not be made ready, its name as the place.
  std::optional<Error> method_failure;
  std::string law;          ///< of soft tissue
  std::string law_awaited;  ///< that is felt as soon as its surfaces are made; empty: none
  /// Why the law that was asked for last could not be, its name as the place.
  std::optional<Error> law_failure;
  bool friction = true, viscosity = true, passivity = true, paused = false;
  bool motor = false;                    ///< of the tools that cut: their switch
  bool motor_is_on = false;              ///< by its switch or a pedal
  std::uint64_t sweeps = 0;              ///< of a burr, that are taken from what the scene shows
  std::vector<std::uint64_t> undone_to;  ///< how many of them were left after each undo until now
  std::size_t strokes_to_undo = 0, strokes_to_redo = 0;
  std::map<LabelId, double> removed_mm3;  ///< by them, of each structure
  std::map<LabelId, double> nearest_mm;   ///< to what is protected (NearestMeter)
  double max_force_N = 0;
  std::array<double, 4> rotation_wxyz{1, 0, 0, 0};
  std::uint32_t model_version = 1;
  std::vector<ViewedTissueState> tissues;
  /// Of the stop that holds (Arming::number), which a rearm names; empty: the force is not stopped.
  std::optional<std::uint32_t> stop;
  StoppedBy stopped_by = StoppedBy::kSession;  ///< of that stop
  std::uint32_t stopped_by_viewer = 0;         ///< its ViewerIdentity::number, where a viewer stopped
  bool armed = false;                          ///< a physical device may push
  bool recording = false;
  /// Where a recording is looked at.
  struct Playback {
    bool playing = false;
    double speed = 1;
    std::optional<Error> failure;  ///< why no more of it can be shown
  };
  std::optional<Playback> playback;
  /// What a teacher has chosen.
  struct Lesson {
    std::string learner;  ///< whose the runs are, a pseudonym; empty: nobody's
    std::string task;     ///< ViewedTask::name of the only one that may be begun; empty: any may
    /// Whether somebody may begin a run as that learner.
    bool is_for(const std::string& other) const { return learner.empty() || learner == other; }
  };
  Lesson lesson;
};

/// How soft tissue has yielded around a device's tool: places moved by so much, on a grid of their own.
struct ViewedYield {
  std::uint32_t frame = 0;  ///< YieldFrame::number
  std::array<int, 3> nodes{0, 0, 0};
  std::array<double, 3> first_patient_mm{};               ///< of node 0, 0, 0
  std::array<double, 9> axes{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< its columns, orthonormal; row by row
  double spacing_mm = 1;
  std::vector<float> moved_mm;  ///< x, y, z in the patient of each node, i fastest
};

/// A viewer, as a session tells who asked it for something.
struct ViewerIdentity {
  std::uint32_t number = 0;  ///< from 1, in the order in which they said hello
  bool control = false;      ///< it may change things; a stop is everybody's
};

/// A request that is well formed; whether it is granted is for the host to say.
struct SettingsRequest {
  std::optional<std::string> method, law;
  std::optional<bool> friction, viscosity, passivity, paused, motor;
  std::optional<double> max_force_N;
  std::optional<std::array<double, 4>> rotation_wxyz;
  ViewerIdentity by;
  std::int64_t id = 0;  ///< of the viewer's own, for a late answer
};
struct TissueRequest {
  int tissue = 0;
  std::optional<double> stiffness_N_per_mm, static_friction, dynamic_friction, viscosity_N_s_per_mm;
  ViewerIdentity by;
  std::int64_t id = 0;
};
/// The last stroke of a burr undone, or the last one that was undone done again.
struct StrokeRequest {
  StrokeAction action = StrokeAction::kUndo;
  ViewerIdentity by;
  std::int64_t id = 0;
};
/// Force back after a stop.
struct RearmRequest {
  std::uint32_t stop = 0;  ///< which stop it answers: that of the state that whoever rearms has seen
  ViewerIdentity by;
  std::string code = {};  ///< that is shown where a device that may push is; empty: none was given
};

/// What is chosen for a lesson; what is left out stays.
struct LessonRequest {
  std::optional<std::string> learner, task;  ///< as ViewedState::Lesson has them
  std::optional<bool> names;                 ///< learners are shown what a quiz hides
  bool end = false;                          ///< the session ends
};

/// What is to be seen of a recording.
struct PlayRequest {
  std::optional<double> at_s;   ///< the recording's own time; beyond its ends: that end
  std::optional<bool> playing;  ///< at the end it begins anew
  std::optional<double> speed;  ///< times as fast as it was, kPlayingSpeeds; below 0: backwards
};
/// Least and greatest of a speed, without its sign.
inline constexpr std::array<double, 2> kPlayingSpeeds{0.01, 32};

/// What became of a request for a change, where it was not refused.
enum class Grant : std::uint8_t {
  kDone,
  kAsked,  ///< somebody at the device is asked whether it may be: a LateAnswer follows
};
/// The answer to what was asked, when somebody has agreed to it or nobody has.
struct LateAnswer {
  ViewerIdentity by;
  std::int64_t id = 0;
  Result<void> outcome;
};

/// A session as its viewers know it. Every member is called on the server's own thread (scene() also by
/// start()), none may wait for the servo, and none takes longer than a tick of a model may take to be copied
/// (milliseconds).
class ViewerHost {
 public:
  virtual ~ViewerHost() = default;
  /// The same all the time, on which start() relies. Its scan and labels are on one grid.
  virtual const ViewedScene& scene() const = 0;
  /// The latest tick. @param stiffness_N_per_mm  of the touched tissue of each device as it is felt
  virtual TickRecord snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const = 0;
  virtual ViewedHealth health() const = 0;
  virtual ViewedState state() const = 0;
  /// Of ViewedState::sweeps those from number `first` on, 0 the first, at most so many; in their order.
  /// @param version  ViewedState::model_version; what is shown may be another one by now
  virtual std::vector<SweepRecord> sweeps(std::uint32_t /*version*/, std::uint64_t /*first*/,
                                          std::size_t /*most*/) const {
    return {};
  }
  /// The scene's labels without what burrs have taken from them by now, as sweeps() tells it. On any thread,
  /// and not for one that is waited for: a recording's are cut as they are asked for.
  virtual std::shared_ptr<const Bricks<LabelId>> labels() const { return scene().labels; }
  /// How tissue has yielded around a device's tool; null: it has not.
  virtual std::shared_ptr<const ViewedYield> yielded(std::size_t /*device*/) const { return nullptr; }
  /// labels() where tissue that has yielded is seen, for pictures. Takes its time, as labels() may; the same
  /// object as long as nothing has changed.
  virtual std::shared_ptr<const Bricks<LabelId>> seen_labels() const { return labels(); }
  /// Of a session with a tracked tool; empty: it has none.
  virtual std::optional<ViewedNavigation> navigation() const { return {}; }
  /// All of what is asked, or an error that names the value and nothing of it.
  virtual Result<Grant> set(const SettingsRequest& request) = 0;
  virtual Result<Grant> set(const TissueRequest& request) = 0;
  virtual Result<Grant> set(const StrokeRequest& request) = 0;
  /// Answers to what was asked before, each once.
  virtual std::vector<LateAnswer> take_answers() = 0;
  /// A viewer is gone: what it has asked for and what nobody has agreed to yet is not done any more.
  virtual void forget(const ViewerIdentity& viewer) = 0;
  /// Only ever stops.
  virtual void emergency_stop(const ViewerIdentity& by) = 0;
  /// Error kUsage where a device is physical, where another stop came after the one that it answers, where
  /// the tip touches something, and where nothing is stopped.
  virtual Result<void> rearm(const RearmRequest& request) = 0;
  /// Whether a viewer may move the tip; whether one does. Error kUsage where something else moves it.
  /// @param by  who takes it, or leaves it
  virtual Result<void> take_pointer(bool take, const ViewerIdentity& by) = 0;
  /// The tip that the pointer wants, patient, mm; finite.
  virtual void move_pointer(const std::array<double, 3>& tip_patient_mm) = 0;
  /// Error kUsage where a session runs.
  virtual Result<void> play(const PlayRequest& request) = 0;
  /// How far a run of one of the scene's tasks is.
  virtual ViewedTraining training() const { return {}; }
  /// Of the last run, when it is over and was kept; null: there is none.
  virtual std::shared_ptr<const ViewedDebriefing> debriefing() const { return nullptr; }
  /// A run begins, or ends.
  virtual Result<void> train(const TaskRequest& /*request*/) {
    return Error{ErrorKind::kUsage, "there are no tasks here", "", ""};
  }
  /// Of a lesson, but for the names, which are the server's to show.
  virtual Result<void> teach(const LessonRequest& /*request*/) {
    return Error{ErrorKind::kUsage, "there is no session here that a lesson could be of", "", ""};
  }
  /// Runs of learners are kept, and curves can be made of them.
  virtual bool keeps_runs() const { return false; }
  /// A page of HTML with the curves of a learner's runs, or of everybody's (empty). On any thread; may take
  /// long.
  virtual Result<std::string> curves(const std::string& /*learner*/) const {
    return Error{ErrorKind::kUsage, "no runs are kept here", "", "start palpate explore with --learner"};
  }
  /// That is rehearsed, another object after each change; null: there is none.
  virtual std::shared_ptr<const ViewedPlan> plan() const { return nullptr; }
  /// All of what is asked, or an error. Of saving the disk is waited for.
  virtual Result<void> change(const PlanRequest& /*request*/) {
    return Error{ErrorKind::kUsage, "there is no plan here", "", "start palpate explore with --plan"};
  }
};

/// Whom new tokens are for.
struct NewTokens {
  std::string role;  ///< "view", "control", "learner", "teacher"; empty: one for control and one to look on
  std::string learner;  ///< of a learner, whose pseudonym it is
};
/// The lines of a token file, each with a new token of 130 bits of the kernel's random numbers. Errors:
/// kBadInput for what cannot be a pseudonym, kUsage for a pseudonym without the role or the role without one,
/// kUnavailable where there are no random numbers.
Result<std::string> new_viewer_tokens(const NewTokens& wanted = {});
/// Writes such lines to a new file that its owner alone may read. Errors: kOutput for a file that is there
/// already or cannot be written; nothing of it is left then.
Result<void> write_viewer_tokens(const std::filesystem::path& file, const std::string& lines);
/// Whose tokens a file has.
struct TokenHolders {
  std::vector<std::string> learners;
  bool teacher = false;
};
/// Errors: those of reading it.
Result<TokenHolders> holders_of_tokens(const std::filesystem::path& file);

struct ViewerServerOptions {
  std::string address = "127.0.0.1";  ///< a numeric one; other than loopback wants tokens
  int port = kViewerPort;             ///< 0: any that is free
  /// Lines "control TOKEN", "view TOKEN", "teacher TOKEN" and "learner TOKEN PSEUDONYM", tokens of at least
  /// 16 printable characters without blanks, and comments that begin with '#'; empty: none. Tokens that could
  /// be guessed are warned of in `log`, or refused.
  std::filesystem::path token_file;
  std::filesystem::path tls_certificate, tls_key;  ///< PEM; both or neither
  /// Further names by which the server is asked for, NAME or, behind a tunnel, NAME:PORT.
  std::vector<std::string> host_names;
  /// Faults of viewers, one line each without what they sent. Called on the server's thread, and by start().
  std::function<void(const std::string&)> log;
};

/// Serves the page and the session until it is destroyed. Three threads of its own: one
/// for all viewers and one that makes volumes for them at ordinary priority, one at the lowest that draws
/// pictures of the volume (and has helpers while it does).
class ViewerServer {
 public:
  /// Everything that start() refuses of options but the port, which may be taken: before long work. Logs
  /// nothing.
  static Result<void> check(ViewerServerOptions options);
  /// Errors: kUsage for options that do not go together (an address beyond loopback without tokens, a
  /// certificate without its key); kBadInput for a token file or certificate that cannot be read, with its
  /// line; kUnavailable for an address, a port or threads that cannot be had.
  /// @param host  outlives the server
  static Result<std::unique_ptr<ViewerServer>> start(ViewerHost& host, const ViewerServerOptions& options);
  virtual ~ViewerServer() = default;
  /// "http://127.0.0.1:8480/"; of a server that listens at all addresses, one that other machines may open.
  virtual std::string url() const = 0;
  virtual int port() const = 0;
  virtual int viewers() const = 0;
};

}  // namespace palpate
