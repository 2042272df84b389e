#pragma once

#include <array>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/bundle_message.h"
#include "server/deformation_message.h"
#include "server/download_rate_limiter.h"
#include "server/fault_log.h"
#include "server/payload_store.h"
#include "server/pose_message.h"
#include "server/request.h"
#include "server/scene_json.h"
#include "server/site.h"
#include "server/transport.h"

namespace palpate::server {

class Connection;
class Viewer;
struct SentSweeps;

/// Shared state of a server's connections: the site, the session, the owner of the pointer. Used on the
/// server's thread only.
///
///    timer, 120 Hz ── snapshot ── one PoseMessage ──► every viewer whose pose is due
///            15 Hz ── tissue deformation ─────────► subscribed viewers, if it has changed
///            20 Hz ── progress of a task's run ───► subscribed viewers, if it has changed
///    timer, 10 Hz ─── state, health; time limits of every connection
class Hub {
 public:
  using Clock = std::chrono::steady_clock;
  /// Maximum number of viewers after their hello, and of connections including them.
  static constexpr std::size_t kMaxViewers = 64, kMaxConnections = 256;
  /// Slots reserved for viewers with control or a teacher's role.
  static constexpr std::size_t kReservedSlots = 2;
  /// Maximum number of WebSockets before their hello, when their role is not known yet.
  static constexpr std::size_t kMaxUnauthenticated = 16;
  /// A single viewer downloads scan and labels concurrently.
  static constexpr std::ptrdiff_t kDownloadsPerViewer = 2;

  /// @param loop,     host, site, volumes, pictures  outlive the hub
  /// @param pictures  null: no pictures of the volume are rendered
  Hub(EventLoop& loop, ViewerHost& host, Site& site, PayloadStore& volumes, PictureStore* pictures,
      DownloadRateLimiter downloads, FaultLog log, std::function<void(int)> on_viewer_count);
  ~Hub();

  void begin();
  /// Closes every viewer's connection with a code, without waiting for answers.
  void end();

  // ---- connections

  void add(std::shared_ptr<Connection> connection);
  void remove(const std::shared_ptr<Connection>& connection);
  void add(std::shared_ptr<Viewer> viewer);
  void remove(const std::shared_ptr<Viewer>& viewer);
  /// If there are too many WebSockets before their hello, closes the oldest: clients without a token cannot
  /// lock out those with one.
  void drop_oldest_unauthenticated();
  /// Whether a viewer that says hello gets a slot. For a role with a reserved slot, the most recent viewer
  /// of another role is closed if necessary.
  bool make_room_for_viewer(Role role);
  /// If all slots are taken, closes one connection: the one without progress for the longest time,
  /// preferring those that wait for a request, then those that are sending, then those whose answer is being
  /// generated.
  void make_room_for_connection();

  // ---- services for connections

  Site& site() { return site_; }
  std::unique_ptr<Timer> timer() { return loop_.timer(); }
  FaultLog& log() { return log_; }
  /// Next part of a connection's download whose previous part has been sent.
  DownloadRateLimiter::Chunk next_chunk(std::size_t left_bytes);
  /// Asynchronous requests; `then` is called on the server's thread.
  void request_picture(PictureKey key, std::weak_ptr<const void> requester,
                       std::function<void(PictureStore::Payload)> then);
  void request_volume(const PayloadKey& key, std::function<void(PayloadStore::Payload)> then);
  /// Only if Site::stores_runs.
  /// @param learner  pseudonym; empty: all learners
  void request_curves(const std::string& learner, std::function<void(Result<std::string>)> then);

  // ---- requests of viewers

  /// Admits a viewer after its hello: it is counted and receives poses.
  void welcome(Viewer& viewer);
  /// Carries out a request and returns the answer.
  std::string answer(Viewer& viewer, const Request& request);
  void move_pointer(const Viewer& viewer, const TipMessage& tip);
  /// Publishes the state to every viewer if it has changed.
  void publish_state();
  std::string state_for(const Viewer& viewer) const;
  /// First message to a viewer: its role and permissions.
  std::string welcome_for(const AuthenticatedViewer& who) const;
  /// Redaction that applies to a viewer; null: none.
  const Redaction* redaction_of(const Viewer& viewer) const;
  /// Redaction that currently applies to learners; null: none.
  const Redaction* active_redaction() const;
  /// ViewerHost::tick_history
  const TickHistory* tick_history() const { return host_.tick_history(); }
  /// Memory for the ticks of a bundle while it is made.
  std::span<BundledTick> bundle_scratch() { return bundle_scratch_; }
  /// Message with the next sweeps for a viewer, and marks them as sent; empty: no more.
  std::string sweeps_after(SentSweeps& sent) const;
  /// Latest deformation around a device.
  const PublishedDeformation& published_deformation(std::size_t device) const {
    return deformations_[device].published;
  }
  /// Latest plan; null if there is none, and for a redacted viewer, because a plan may reveal what is hidden.
  std::shared_ptr<const std::string> published_plan(const Viewer& viewer) const;
  /// Publishes the progress of a run if it has changed.
  void publish_training(Clock::time_point now);
  /// Progress message published last; empty: the session has no tasks.
  const std::string& published_training(const Viewer& viewer) const;
  /// Latest error estimate of a tracked tip; null: none.
  const std::shared_ptr<const std::string>& published_navigation() const { return navigation_json_; }
  /// Debriefing of the last run; null if there is none, or if the viewer is a learner and the run was another
  /// learner's.
  std::shared_ptr<const std::string> published_debriefing(const Viewer& viewer) const;

 private:
  static std::uint64_t sweeps_in_common(const ViewedState& before, const ViewedState& now);
  bool has_single_downloader() const;
  Result<RequestOutcome> execute(Viewer& viewer, const Request& request);
  Result<void> execute_rearm(Viewer& viewer, RearmRequest request);
  Result<void> execute_task(Viewer& viewer, TaskRequest request);
  Result<void> execute_lesson(const LessonRequest& request);
  Result<void> check_may_operate(const Viewer& viewer) const;
  Result<void> check_may_hand_over(const LessonRequest& request) const;
  void hand_over_pointer(const Viewer* to);
  const Viewer* viewer_of_learner(const std::string& learner) const;
  std::vector<ListedLearner> listed_learners() const;
  void update_redaction();
  void deliver_late_answers();
  Result<void> execute_pointer(Viewer& viewer, const PointerRequest& request);
  Result<void> execute_play(const PlayRequest& request);
  /// Number of the viewer that moves the tip; 0: none.
  std::uint32_t pointer_owner() const;
  void update_viewer_count();
  void wait_for_poses();
  void publish_due();
  void publish_deformation(Clock::time_point now);
  void publish_plan();
  void publish_navigation(Clock::time_point now);
  void stop_when_delivered(Clock::time_point latest);
  void schedule_housekeeping();
  void run_housekeeping();

  ViewerHost& host_;
  LiveHost* const live_;  ///< The host as a running session; null if it is none
  Site& site_;
  PayloadStore& volumes_;
  PictureStore* const pictures_;
  DownloadRateLimiter downloads_;
  FaultLog log_;
  const std::function<void(int)> on_viewer_count_;

  EventLoop& loop_;
  const std::unique_ptr<Timer> pose_timer_, housekeeping_timer_;
  Clock::time_point next_pose_{};
  std::set<std::shared_ptr<Connection>> connections_;
  std::set<std::shared_ptr<Viewer>> viewers_;
  int welcomed_ = 0;
  std::uint32_t last_viewer_number_ = 0;  ///< Number of viewers that have said hello so far
  bool pose_timer_runs_ = false, ended_ = false;
  const Viewer* pointer_owner_ = nullptr;  ///< Viewer that moves the tip; may be null
  ViewedState state_;
  std::string last_state_json_,
      last_redacted_state_json_;  ///< Last messages: as a teacher receives them, and redacted
  std::optional<RedactedSteps> redacted_steps_;
  TickRecord redacted_tick_;             ///< Last redacted tick
  bool are_hidden_names_shown_ = false;  ///< Whether learners get the names hidden by a quiz
  ViewedHealth health_;
  std::vector<BundledTick> bundle_scratch_ = std::vector<BundledTick>(kMaxBundledTicks);
  struct LastPublished {
    std::shared_ptr<const ViewedDeformation> deformation;
    std::optional<DeformationMessage> message;  ///< Message published last
    PublishedDeformation published;
  };
  std::array<LastPublished, kMaxDevices> deformations_;
  Clock::time_point next_deformation_{};
  std::shared_ptr<const ViewedPlan> plan_;
  std::shared_ptr<const std::string> plan_json_;
  std::shared_ptr<const std::string> navigation_json_;
  Clock::time_point next_navigation_{};
  std::string training_json_, redacted_training_json_;
  std::shared_ptr<const ViewedDebriefing> viewed_debriefing_;
  std::shared_ptr<const std::string> debriefing_json_;
  Clock::time_point next_training_{};
};

}  // namespace palpate::server
