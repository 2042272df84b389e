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
#include "palpate/device/settings.h"
#include "palpate/device/telemetry.h"
#include "palpate/server/viewed_plan.h"
#include "palpate/server/viewed_training.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// Viewer server: lets browsers on this or another machine observe and control a session by HTTP and
/// WebSocket, as specified in docs/reference/viewer-protocol.md. The server depends on neither the servo nor
/// the model: it obtains data from a ViewerHost and passes requests to it.
namespace palpate {

/// Default port of the viewer's page.
inline constexpr int kViewerPort = 8480;

/// Tissue of the scene.
struct ViewedTissue {
  std::string name;
  /// Whether the tissue renders contact.
  bool touchable = true;
  Rgb colour;
  double opacity = 1;
  /// Indices of the tissues that support this one.
  std::vector<int> rests_on;
  std::string protection = "none";  ///< Protection from a burr: "none", "alarm" or "keep"
};
/// Structure of the label map.
struct ViewedStructure {
  LabelId label = 0;
  std::string name;
  Rgb colour;
  int tissue = -1;                   ///< Index of its tissue; -1: none
  std::vector<LabelId> within = {};  ///< Labels of the structures in which it is nested (Model::enclosing)
};
/// Known limitation of the model (Caveat), shown as a warning.
struct ViewedCaveat {
  std::string concerns;  ///< Its subject: "placement", "side" or "force"
  std::string text;      ///< Caveat::text
};
/// Recording as shown on a time line. Times are those of the recording.
struct ViewedRecording {
  std::uint64_t ticks = 0;
  double begin_s = 0, end_s = 0;  ///< Times of the first and the last tick
  struct Contact {
    double begin_s = 0, end_s = 0;
    LabelId label = 0;
    double max_N = 0;  ///< Maximum force during the contact
    int device = 0;    ///< Index of the recording's device
  };
  std::vector<Contact> contacts;  ///< Contacts of all devices, by begin
  /// Number of omitted contacts; the shortest are omitted if there are too many
  std::uint64_t omitted_contacts = 0;
  struct Event {
    double time_s = 0;
    std::string kind;                  ///< "stop", "rearm", "settings", "model"
    std::vector<std::string> changed;  ///< "settings": names of changed settings, or "pointer"
    int tissue = -1;           ///< "model": index of the changed tissue; -1 if the fields were regenerated
    std::string by;            ///< Originator: "viewer", "key", "script" or "session"
    std::uint32_t viewer = 0;  ///< Number of the viewer, if a viewer requested it
  };
  std::vector<Event> events;
  /// Number of omitted events: beyond the maximum, or without a tick in which they took effect.
  std::uint64_t omitted_events = 0;
  std::vector<double> force_N;  ///< Maximum force of any device within each of equal tick intervals
};

/// Tool of a device.
struct ViewedTool {
  std::string name;
  double radius_mm = 0;
  bool cuts = false;  ///< Whether it has a motor
  /// Shape of a burr's head: "ball", "cylinder" or "cone"; empty: not a burr
  std::optional<std::string> burr;
  std::vector<std::array<double, 3>> points_mm;
  struct Capsule {
    std::array<double, 3> from_mm, to_mm;     ///< Ends of its axis, in the tip's frame
    double radius_mm = 0, end_radius_mm = 0;  ///< Radii at either end; linear in between
  };
  std::vector<Capsule> capsules;  ///< Head of a burr that is not a ball
  bool shaver = false;            ///< Whether a cutting tool is called a shaver rather than a burr
  double revolutions_per_s = 0;   ///< Rotation rate of a burr while its motor runs; 0: not a burr
  int flutes = 0;                 ///< Number of a burr's cutting edges; 0: not a burr
};
/// Calls `of(name, value)` for every member of a tool as viewers get it. Messages and the page's types are
/// derived from it; a member that it does not bind fails to compile.
template <class Visit>
void visit_fields(const ViewedTool& tool, Visit&& of) {
  const auto& [name, radius_mm, cuts, burr, points_mm, capsules, shaver, revolutions_per_s, flutes] = tool;
  of("name", name);
  of("radius_mm", radius_mm);
  of("cuts", cuts);
  of("burr", burr);
  of("points_mm", points_mm);
  of("capsules", capsules);
  of("shaver", shaver);
  of("revolutions_per_s", revolutions_per_s);
  of("flutes", flutes);
}
template <class Visit>
void visit_fields(const ViewedTool::Capsule& capsule, Visit&& of) {
  const auto& [from_mm, to_mm, radius_mm, end_radius_mm] = capsule;
  of("from_mm", from_mm);
  of("to_mm", to_mm);
  of("radius_mm", radius_mm);
  of("end_radius_mm", end_radius_mm);
}

/// Forbidden region.
struct ViewedNoGo {
  struct Plane {
    /// Patient frame; unit normal, pointing to the permitted side
    std::array<double, 3> point_mm{}, outward{};
  };
  struct Ball {
    std::array<double, 3> centre_mm{};  ///< Patient frame
    double radius_mm = 0;
  };
  std::string name;
  double keep_away_mm = 0;                   ///< Distance from the region at which the force begins
  std::variant<LabelId, Plane, Ball> shape;  ///< A structure, the half-space behind a plane, or a ball
};

/// Scene data that is constant during a session. Apart from the names of structures and tissues it contains
/// no patient data.
struct ViewedScene {
  std::string side = "unknown";  ///< "left", "right", "both", "unknown"
  bool oriented = true;
  std::vector<ViewedCaveat> caveats;
  std::string modality = "unknown";               ///< "ct", "mr", "unknown"
  std::uint64_t content_hash = 0;                 ///< Hash of scan and labels; changes with any voxel
  std::shared_ptr<const Volume<float>> scan;      ///< May be null
  std::shared_ptr<const Bricks<LabelId>> labels;  ///< Never null
  std::array<double, 2> window{0, 1};             ///< Initial display window of the scan
  /// Homogeneous matrix, row-major, translation in mm.
  std::array<std::array<double, 4>, 4> world_from_patient{};
  std::vector<ViewedStructure> structures;
  std::vector<ViewedTissue> tissues;
  std::vector<ViewedTool> tools;     ///< Tool of each device; never empty
  std::vector<std::string> methods;  ///< Force methods that can be chosen
  std::vector<std::string> laws;     ///< Tissue laws that can be chosen; none without soft tissue
  std::string device_name;
  bool simulated = true;
  /// Source of the tip's motion: "script", "pointer", "ros2", "device", "recording"
  std::string input = "script";
  /// Ratings of the first device; kNoValue: unknown.
  double peak_force_N = kNoValue, continuous_force_N = kNoValue, max_stiffness_N_per_mm = kNoValue;
  ValueRange max_force_range{};  ///< Range of the user's force limit; N
  double rate_hz = 1000;
  std::optional<ViewedRecording> recording;  ///< Recording shown in place of a session
  std::vector<ViewedTask> tasks;             ///< Tasks that may be begun
  /// Distance within which ticks report the distance to a structure; empty: ticks report none.
  std::optional<double> distance_reach_mm;
  std::vector<ViewedNoGo> no_go;  ///< In the order of the indices in DeviceTick::no_go

  /// Whether ticks report distances or no-go regions.
  bool reports_distances() const { return distance_reach_mm.has_value() || !no_go.empty(); }
};

/// Estimated error of a tracked tool's displayed tip.
struct ViewedNavigation {
  int device = 0;  ///< Index of the tracked device
  /// Whether the tracker currently sees the tool; if not, the tip stays at its last position
  bool is_visible = true;
  double fre_mm = 0;  ///< Fiducial registration error
  struct Error {
    double rms_mm = 0, max_mm = 0;  ///< Root mean square, and 95th percentile
    bool is_far = false;            ///< Whether the tip is far outside the registration's points
  };
  std::optional<Error> tip;  ///< Empty: unknown
};

/// Timing of the loop over the last second, and totals since it began.
struct ViewedHealth {
  double rate_hz = 0;
  /// Lateness of ticks and compute time per tick over the last second: quantiles and maximum.
  double lateness_p50_us = 0, lateness_p99_us = 0, lateness_max_us = 0, compute_p50_us = 0;
  /// Totals since the loop began.
  std::uint64_t skipped = 0, dropped = 0, stalls = 0;
};

/// Originator of a stop.
enum class StoppedBy : std::uint8_t {
  kSession,  ///< The session itself, when its supervisor was missing
  kKey,      ///< A key where palpate runs
  kViewer,
};
/// Session state that may change at any time.
struct ViewedState : Settings {
  std::string method_awaited;  ///< Method that becomes active once its fields are generated; empty: none
  /// Reason why the method requested last could not be prepared; Error::where is its name.
  std::optional<Error> method_failure;
  std::string law;          ///< Law of soft tissue
  std::string law_awaited;  ///< Law that becomes active once its surfaces are built; empty: none
  /// Reason why the law requested last could not be prepared; Error::where is its name.
  std::optional<Error> law_failure;
  /// Edge length of the cells in which the law solves soft tissue, and the length that the scene requests,
  /// mm: a machine that is too slow solves in coarser ones. 0: the law solves none.
  double law_cell_mm = 0, requested_cell_mm = 0;
  bool motor_is_on = false;              ///< Whether a motor runs, by its switch or a pedal
  std::uint64_t sweeps = 0;              ///< Number of burr sweeps removed from the labels
  std::vector<std::uint64_t> undone_to;  ///< Number of sweeps left after each undo so far
  std::size_t strokes_to_undo = 0, strokes_to_redo = 0;
  std::map<LabelId, double> removed_mm3;  ///< Volume removed by the sweeps, per structure
  double broken_off_mm3 = 0;              ///< Part of it that was not cut, but cut loose: fragments
  std::map<LabelId, double>
      nearest_mm;  ///< Smallest distance to each protected structure (ProtectedDistanceMeter)
  std::uint32_t model_version = 1;
  std::vector<ContactProperties> tissues;  ///< Current properties of each tissue
  /// Number of the stop in effect (Arming::number), to which a rearm refers; empty: the force is not stopped.
  std::optional<std::uint32_t> stop;
  StoppedBy stopped_by = StoppedBy::kSession;  ///< Originator of that stop
  std::uint32_t stopped_by_viewer = 0;         ///< ViewerIdentity::number, if a viewer stopped the force
  bool armed = false;                          ///< Whether a physical device can apply force
  bool recording = false;
  /// Playback of a recording.
  struct Playback {
    bool playing = false;
    double speed = 1;
    std::optional<Error> failure;  ///< Reason why no more of it can be shown
  };
  std::optional<Playback> playback;
  /// A teacher's choices.
  struct Lesson {
    std::string learner;   ///< Pseudonym of the runs' learner; empty: none
    std::string task;      ///< ViewedTask::name of the only task that may be begun; empty: any
    bool is_over = false;  ///< Whether a teacher has ended the session, which closes shortly
    /// Whether a run may be begun as that learner.
    bool is_for(const std::string& other) const { return learner.empty() || learner == other; }
  };
  Lesson lesson;
};

/// Displacement field of soft tissue around a device's tool, on a regular grid.
struct ViewedDeformation {
  std::uint32_t frame = 0;  ///< ComplianceFrame::number
  std::array<int, 3> nodes{0, 0, 0};
  std::array<double, 3> first_patient_mm{};  ///< Position of node (0, 0, 0); patient frame
  /// Orthonormal grid axes as columns of a row-major matrix
  std::array<double, 9> axes{1, 0, 0, 0, 1, 0, 0, 0, 1};
  double spacing_mm = 1;
  std::vector<float> moved_mm;  ///< Displacement of each node in the patient frame: x, y, z; i fastest
};

/// Identity of a viewer, as passed to the session with its requests.
struct ViewerIdentity {
  std::uint32_t number = 0;  ///< From 1, in the order of the viewers' hello messages
  bool control = false;      ///< Whether it may change things; every viewer may stop
  std::string learner{};     ///< Pseudonym of a learner with a token; empty: another role
  bool teaches = false;      ///< Whether it leads the lesson; its actions are not attributed to a learner
};

/// Well-formed request; the host decides whether to grant it.
struct SettingsRequest : SettingsChanges {
  ViewerIdentity by;
  std::int64_t id = 0;  ///< Identifier chosen by the viewer, for a late answer
};
struct TissueRequest {
  int tissue = 0;
  ContactPropertyChanges changes;
  ViewerIdentity by;
  std::int64_t id = 0;
};
/// Undoes a burr's last stroke, or redoes the stroke undone last.
struct StrokeRequest {
  StrokeAction action = StrokeAction::kUndo;
  ViewerIdentity by;
  std::int64_t id = 0;
};
/// Request to enable the force again after a stop.
struct RearmRequest {
  std::uint32_t stop = 0;  ///< Number of the stop that the viewer has seen
  ViewerIdentity by;
  std::string code = {};  ///< Code displayed next to a physical device; empty: none given
};

/// Settings of a lesson; missing values stay unchanged.
struct LessonRequest {
  std::optional<std::string> learner{}, task{};  ///< As in ViewedState::Lesson
  std::optional<bool> names{};                   ///< Whether learners are shown what a quiz hides
  /// Pseudonym of the learner whose page gets the pointer; empty: the current owner loses it
  std::optional<std::string> pointer{};
  bool end = false;  ///< Ends the session
};

/// Playback control of a recording.
struct PlayRequest {
  std::optional<double> at_s;   ///< Time of the recording; clamped to its ends
  std::optional<bool> playing;  ///< Playing at the end restarts from the beginning
  std::optional<double> speed;  ///< Ratio to real time, within kPlayingSpeeds; negative: backwards
};
/// Minimum and maximum magnitude of the playback speed.
inline constexpr std::array<double, 2> kPlayingSpeeds{0.01, 32};

/// Outcome of a request that was not refused.
enum class RequestOutcome : std::uint8_t {
  kDone,
  kAwaitingConsent,  ///< The operator at the device is asked for consent; a LateAnswer follows
};
/// Outcome of a request that waited for consent.
struct LateAnswer {
  ViewerIdentity by;
  std::int64_t id = 0;
  Result<void> outcome;
};

class LiveHost;
class PlaybackHost;
class TickHistory;

/// Source of the data that viewers observe: a live session or a recording. A host that is neither a LiveHost
/// nor a PlaybackHost is read-only, except for the emergency stop. scene(), snapshot(), health(), state(),
/// labels() and emergency_stop() are called on any thread, every other member on the server's unless stated
/// otherwise; none may wait for the servo, and none may take longer than copying one tick's data
/// (milliseconds).
class ViewerHost {
 public:
  virtual ~ViewerHost() = default;
  /// This host as a running session or as a recording; null if it is not one.
  virtual LiveHost* live() { return nullptr; }
  virtual PlaybackHost* playback() { return nullptr; }

  /// The same object for the lifetime of the server. Scan and labels share one grid.
  virtual const ViewedScene& scene() const = 0;
  /// Latest tick.
  /// @param stiffness_N_per_mm  rendered stiffness of the tissue in contact, per device
  virtual TickRecord snapshot(std::array<double, kMaxDevices>& stiffness_N_per_mm) const = 0;
  /// All recent ticks, for viewers that receive every one; null: there are none, as in a recording. Constant;
  /// outlives the server.
  virtual const TickHistory* tick_history() const { return nullptr; }
  virtual ViewedHealth health() const = 0;
  virtual ViewedState state() const = 0;
  /// Sweeps of ViewedState::sweeps from index `first` on, at most `most`, in order.
  /// @param version  ViewedState::model_version; the current version may be newer
  virtual std::vector<SweepRecord> sweeps(std::uint32_t /*version*/, std::uint64_t /*first*/,
                                          std::size_t /*most*/) const {
    return {};
  }
  /// The scene's labels minus the volume removed so far, consistent with sweeps(). Called on any thread; not
  /// for time-critical callers, since a recording's labels are computed on demand.
  virtual std::shared_ptr<const Bricks<LabelId>> labels() const { return scene().labels; }
  /// Deformation around a device's tool; null: none.
  virtual std::shared_ptr<const ViewedDeformation> deformation(std::size_t /*device*/) const {
    return nullptr;
  }
  /// labels() deformed by soft tissue, for volume pictures. As slow as labels(); returns the same object
  /// while nothing changes.
  virtual std::shared_ptr<const Bricks<LabelId>> visible_labels() const { return labels(); }
  /// Progress of a run of one of the scene's tasks.
  virtual ViewedTraining training() const { return {}; }
  /// Debriefing of the last run, once it is over and stored; null: none.
  virtual std::shared_ptr<const ViewedDebriefing> debriefing() const { return nullptr; }

  /// Stops the force, or a recording that plays; never releases a stop.
  virtual void emergency_stop(const ViewerIdentity& by) = 0;

  /// Plan being rehearsed, a new object after each change; null: none.
  virtual std::shared_ptr<const ViewedPlan> plan() const { return nullptr; }
  /// Carries out the whole request, or returns an error. Saving waits for the disk.
  virtual Result<void> change(const PlanRequest& /*request*/) {
    return Error{ErrorKind::kUsage, "this session has no plan", "", "start palpate explore with --plan"};
  }
};

/// Target of the pointer's tip; patient frame, mm; finite.
struct PointerTarget {
  std::array<double, 3> tip_patient_mm{};
  /// Unit direction in which the tip presses from `tip_patient_mm`, until the force is `force_N`.
  std::array<double, 3> into{};
  double force_N = 0;     ///< 0: no press, the tip moves to `tip_patient_mm`
  bool set_down = false;  ///< The tip is there at once, without a path to it, and its contact is reset
};

/// Running session, which viewers may change.
class LiveHost : public ViewerHost {
 public:
  LiveHost* live() final { return this; }

  /// State of a tracked tool; empty: none.
  virtual std::optional<ViewedNavigation> navigation() const { return {}; }
  /// Carries out the whole request, or returns an error that names the offending value and changes nothing.
  virtual Result<RequestOutcome> set(const SettingsRequest& request) = 0;
  virtual Result<RequestOutcome> set(const TissueRequest& request) = 0;
  virtual Result<RequestOutcome> set(const StrokeRequest& request) = 0;
  /// Outcomes of earlier requests; each is returned once.
  virtual std::vector<LateAnswer> read_answers() = 0;
  /// Discards the pending requests of a viewer that disconnected.
  virtual void forget(const ViewerIdentity& viewer) = 0;
  /// Error kUsage if a device is physical and the code is missing or wrong, if another stop followed the one
  /// referred to, if the tip is in contact, and if nothing is stopped.
  virtual Result<void> rearm(const RearmRequest& request) = 0;
  /// Takes or releases control of the pointer. Error kUsage if the tip has another source.
  /// @param by  viewer that takes or releases it
  virtual Result<void> claim_pointer(bool take, const ViewerIdentity& by) = 0;
  /// Moves the pointer's tip; empty: its pose is stale until the next target.
  virtual void move_pointer(const std::optional<PointerTarget>& target) = 0;
  /// Begins or ends a run.
  virtual Result<void> train(const TaskRequest& /*request*/) {
    return Error{ErrorKind::kUsage, "this session has no tasks", "", ""};
  }
  /// Applies lesson settings, except for the names and the pointer, which the server handles.
  virtual Result<void> teach(const LessonRequest& /*request*/) {
    return Error{ErrorKind::kUsage, "there is no session for a lesson", "", ""};
  }
  /// Whether learners' runs are stored, so that curves can be computed from them.
  virtual bool stores_runs() const { return false; }
  /// HTML page with the learning curves of a learner, or of all learners (empty). Called on any thread; may
  /// take long.
  virtual Result<std::string> curves(const std::string& /*learner*/) const {
    return Error{ErrorKind::kUsage, "this session records no runs", "",
                 "start palpate explore with --learner"};
  }
};

/// Recording played back.
class PlaybackHost : public ViewerHost {
 public:
  PlaybackHost* playback() final { return this; }

  virtual Result<void> play(const PlayRequest& request) = 0;
};

/// Roles for which new tokens are generated.
struct NewTokens {
  /// "view", "control", "learner" or "teacher"; empty: one token for control and one for view
  std::string role;
  std::string learner;  ///< Pseudonym, for the role of learner
};
/// Lines of a token file, each with a new token of 130 bits from the kernel's random number generator.
/// Errors: kBadInput for an invalid pseudonym, kUsage for a pseudonym without the role or the role without
/// one, kUnavailable if no random numbers are available.
Result<std::string> new_viewer_tokens(const NewTokens& requested = {});
/// Writes such lines to a new file that only its owner may read. Errors: kOutput if the file exists or cannot
/// be written; no partial file is left.
Result<void> write_viewer_tokens(const std::filesystem::path& file, const std::string& lines);
/// Holders of a file's tokens.
struct TokenHolders {
  std::vector<std::string> learners;
  bool teacher = false;
};
/// Errors: those of reading the file.
Result<TokenHolders> holders_of_tokens(const std::filesystem::path& file);

/// Options of ViewerServer::start().
struct ViewerServerOptions {
  std::string address = "127.0.0.1";  ///< Numeric address; any other than loopback requires tokens
  int port = kViewerPort;             ///< 0: any free port
  /// File with lines "control TOKEN", "view TOKEN", "teacher TOKEN" and "learner TOKEN PSEUDONYM", with
  /// tokens of at least 16 printable characters without blanks, and comments that begin with '#'; empty:
  /// none. Weak tokens are reported in `log`, or refused.
  std::filesystem::path token_file;
  std::filesystem::path tls_certificate, tls_key;  ///< PEM files; both or neither
  /// Additional host names under which the server is reached: NAME or, behind a tunnel, NAME:PORT.
  std::vector<std::string> host_names;
  /// Receives viewers' faults, one line each, never including what they sent. Called on the server's thread,
  /// and by start().
  std::function<void(const std::string&)> log;
};

/// Serves the page and the session until it is destroyed. Uses three threads: one for all viewers and one
/// that generates volumes, both at ordinary priority, and one at the lowest priority that renders volume
/// pictures (with helper threads while it does).
class ViewerServer {
 public:
  /// Checks everything that start() would refuse, except whether the port is free; for use before long work.
  /// Logs nothing.
  static Result<void> check(ViewerServerOptions options);
  /// @param host  outlives the server
  /// Errors: kUsage for inconsistent options (an address beyond loopback without tokens, a certificate
  /// without its key); kBadInput for a token file or certificate that cannot be read, with its line;
  /// kUnavailable for an address or port that cannot be bound, or threads that cannot be created.
  static Result<std::unique_ptr<ViewerServer>> start(ViewerHost& host, const ViewerServerOptions& options);
  virtual ~ViewerServer() = default;
  /// "http://127.0.0.1:8480/"; for a server on all addresses, one that other machines can open.
  virtual std::string url() const = 0;
  virtual int port() const = 0;
  virtual int viewers() const = 0;
};

}  // namespace palpate
