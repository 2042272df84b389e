#pragma once

#include <array>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "link/download_pace.h"
#include "link/fault_log.h"
#include "link/payload_store.h"
#include "link/pose_message.h"
#include "link/request.h"
#include "link/site.h"
#include "link/transport.h"
#include "link/yield_message.h"

namespace palpate::link {

class Connection;
class Viewer;
struct SweepsHad;

/// What the connections of one server share: the site, the session, who moves the tip. All of it on the
/// server's thread.
///
///     timer, 120 Hz ── snapshot ── one PoseMessage ──► every viewer whose turn it is
///             15 Hz ── how tissue has yielded ──────► every viewer that wants it, where it is another way
///             20 Hz ── how far a run of a task is ──► likewise
///     timer, 10 Hz ─── state, health; deadlines of every connection
class Hub {
 public:
  using Clock = std::chrono::steady_clock;
  /// At most so many viewers that have said hello, and so many connections with them.
  static constexpr std::size_t kMostViewers = 64, kMostConnections = 256;
  /// Those that look on leave so many places to those with control.
  static constexpr std::size_t kKeptForControl = 2;
  /// WebSockets that have yet to say hello: who they are is not known before.
  static constexpr std::size_t kMostSilent = 16;
  /// A viewer loads scan and labels at once.
  static constexpr std::ptrdiff_t kDownloadsOfOne = 2;

  /// @param loop, host, site, volumes, pictures  outlive the hub
  Hub(EventLoop& loop, ViewerHost& host, Site& site, PayloadStore& volumes, PictureStore& pictures,
      DownloadPace downloads, FaultLog log, std::function<void(int)> count_viewers);
  ~Hub();

  void begin();
  /// Tells every viewer that the server ends, and waits for nobody.
  void end();

  // ---- connections

  void add(std::shared_ptr<Connection> connection);
  void remove(const std::shared_ptr<Connection>& connection);
  void add(std::shared_ptr<Viewer> viewer);
  void remove(const std::shared_ptr<Viewer>& viewer);
  /// Of the WebSockets that have not said hello the one that has not for the longest time gives way where
  /// there are many: nobody without a token keeps out those who have one.
  void make_room_for_silent_viewer();
  /// Whether one who says hello finds a place. One with control does as long as others look on, of whom the
  /// one that came last then gives way.
  bool make_room_for_viewer(Role role);
  /// Where all places are taken, one is closed: of those that have yet to say what they want, of those that
  /// take their answer, or else of those that wait for one, the one that has not got on for the longest time.
  void make_room_for_connection();

  // ---- what they need

  Site& site() { return site_; }
  std::unique_ptr<Timer> timer() { return loop_.timer(); }
  FaultLog& log() { return log_; }
  /// The next part of a connection's download, which has sent the one before.
  DownloadPace::Turn next_part(std::size_t left_bytes);
  /// Hand over the bytes on the server's thread.
  void want_picture(PictureKey key, std::weak_ptr<const void> asker,
                    std::function<void(PictureStore::Payload)> then);
  void want_volume(const PayloadKey& key, std::function<void(PayloadStore::Payload)> then);
  /// @param learner  whose; empty: everybody's
  void want_curves(const std::string& learner, std::function<void(Result<std::string>)> then);

  // ---- what viewers ask

  /// A viewer said hello: it counts, and gets poses.
  void welcome(Viewer& viewer);
  /// The answer.
  std::string answer(Viewer& viewer, const Request& request);
  void move_pointer(const Viewer& viewer, const TipMessage& tip);
  /// Tells every viewer what has changed since the last look.
  void look_at_state();
  std::string state_for(const Viewer& viewer) const;
  /// Who one is and what one may do, said to a viewer first.
  std::string welcome_for(const Who& who) const;
  /// Through which a viewer sees the session; null: as it is.
  const Veil* veil_of(const Viewer& viewer) const;
  /// Through which learners see it now; null: as it is.
  const Veil* laid_veil() const;
  /// The next sweeps for a viewer, which has had them then; empty: there are no more.
  std::string sweeps_after(SweepsHad& had) const;
  /// How tissue has yielded around a device, as it was looked at last.
  const ToldYield& told_yield(std::size_t device) const { return yields_[device].told; }
  /// The plan as it was looked at last; null where there is none, and through a veil: whoever made it may
  /// have known what is hidden.
  std::shared_ptr<const std::string> told_plan(const Viewer& viewer) const;
  /// Tells viewers how far a run of a task is, where they do not know.
  void look_at_training(Clock::time_point now);
  /// What a viewer was told of it last; empty: the session has no tasks.
  const std::string& told_training(const Viewer& viewer) const;
  /// How wrong a tracked tip's place may be, as it was looked at last; null: the session has none.
  const std::shared_ptr<const std::string>& told_navigation() const { return told_navigation_; }
  /// Of the last run, null while there is none, and to a learner where it was another's.
  std::shared_ptr<const std::string> told_debriefing(const Viewer& viewer) const;

 private:
  static std::uint64_t sweeps_in_common(const ViewedState& before, const ViewedState& now);
  bool one_loads_alone() const;
  Result<Grant> grant(Viewer& viewer, const Request& request);
  Result<void> grant_rearm(Viewer& viewer, RearmRequest request);
  Result<void> grant_task(Viewer& viewer, TaskRequest request);
  Result<void> grant_lesson(const LessonRequest& request);
  Result<void> check_hand(const Viewer& viewer) const;
  void look_at_veil();
  void answer_late();
  Result<void> grant_pointer(Viewer& viewer, const PointerRequest& request);
  void count();
  void wait_for_poses();
  void show_pose();
  void look_at_yields(Clock::time_point now);
  void look_at_plan();
  void look_at_navigation(Clock::time_point now);
  void wait_for_sweep();
  void sweep();

  ViewerHost& host_;
  Site& site_;
  PayloadStore& volumes_;
  PictureStore& pictures_;
  DownloadPace downloads_;
  FaultLog log_;
  const std::function<void(int)> count_viewers_;

  EventLoop& loop_;
  const std::unique_ptr<Timer> pose_timer_, sweep_timer_;
  Clock::time_point next_pose_{};
  std::set<std::shared_ptr<Connection>> connections_;
  std::set<std::shared_ptr<Viewer>> viewers_;
  int welcomed_ = 0;
  std::uint32_t greeted_ = 0;  ///< viewers that have said hello so far
  bool posing_ = false, ended_ = false;
  /// The number of the viewer that moves the tip, 0 where none does.
  std::uint32_t holder() const;

  const Viewer* pointer_ = nullptr;  ///< who moves the tip
  ViewedState state_;
  std::string last_state_, last_veiled_state_;  ///< as who leads the lesson is told, and through the veil
  std::optional<VeiledSteps> veiled_steps_;
  TickRecord veiled_tick_;  ///< the last one that was shown through the veil
  bool names_ = false;      ///< learners are shown what a quiz hides
  ViewedHealth health_;
  struct LookedAt {
    std::shared_ptr<const ViewedYield> yield;
    std::optional<YieldMessage> message;  ///< as it was told last
    ToldYield told;
  };
  std::array<LookedAt, kMaxDevices> yields_;
  Clock::time_point next_yields_{};
  std::shared_ptr<const ViewedPlan> plan_;
  std::shared_ptr<const std::string> told_plan_;
  std::shared_ptr<const std::string> told_navigation_;
  Clock::time_point next_navigation_{};
  std::string training_, veiled_training_;
  std::shared_ptr<const ViewedDebriefing> debriefed_;
  std::shared_ptr<const std::string> debriefing_;
  Clock::time_point next_training_{};
};

}  // namespace palpate::link
