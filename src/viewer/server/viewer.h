#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/device/telemetry.h"
#include "palpate/server/address.h"
#include "server/bundle_message.h"
#include "server/distance_message.h"
#include "server/pose_message.h"
#include "server/request.h"
#include "server/scene_json.h"
#include "server/token_bucket.h"
#include "server/transport.h"

namespace palpate::server {

class Hub;

/// Sweeps that a viewer has received.
struct SentSweeps {
  std::uint64_t count = 0;  ///< Number of received sweeps that are still valid
  /// Number of sweeps that the page shows; those beyond `count` were undone and must be dropped
  std::uint64_t shown = 0;
};

// close codes of RFC 6455
inline constexpr std::uint16_t kGoingAway = 1001, kTryAgainLater = 1013;

/// WebSocket of one viewer. Its pending output is stored here, never in the hub, and is bounded:
///
///    answers_     texts, in order; when the queue is full, only stop requests are carried out
///    state_due_   the state is serialised when it is sent
///    pose_        latest pose; replaces one not sent yet
///    near_        latest distances; replace those not sent yet; sent before the pose of the same tick
///    ticks_sent_  position in the session's history; the next bundle is made when it is sent
///    training_due_, debriefing_due_  progress of a run, and the last debriefing; serialised when sent
///    plan_sent_    text of the plan sent last; the hub has the latest
///    navigation_sent_  text of the tracked tip's error estimate sent last; the hub has the latest
///    deformations_sent_  number of the deformation message sent last, per device; the hub has the latest
///
/// One write is pending at a time. A viewer that reads slowly therefore only loses its own updates; the
/// kernel's send buffer of its connection is small, so that what does arrive is recent.
class Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param peer, from  the viewer's address, HttpConnection::peer() and from()
  Viewer(std::shared_ptr<WebSocket> socket, std::string peer, const AddressBlock& from, Hub& hub);

  void begin();
  /// Closes the viewer if it exceeds a time limit.
  void check(Clock::time_point now);
  /// Whether a pose is due at the rate that this viewer requested.
  bool is_due(Clock::time_point now) const;
  /// @param near  distances of the same tick; null: the scene has none
  void enqueue_pose(const PoseMessage& pose, const DistanceMessage* near, Clock::time_point now);
  void notify_state();
  /// Announces that a new deformation may be available.
  void notify_deformation();
  /// Announces new progress of a run.
  void notify_training();
  /// Announces a new error estimate of a tracked tip.
  void notify_navigation();
  /// Announces a changed plan.
  void notify_plan();
  /// Queues an answer.
  void send(std::string text);
  /// Closes the connection with a close code, and logs the reason.
  void end(std::uint16_t code, std::string_view fault);
  /// Closes the connection with a close code once all pending output has been sent.
  void finish(std::uint16_t code);
  /// Leaves the hub, with or without a close frame.
  void remove_from_hub();

  bool welcomed() const { return welcomed_; }
  /// Whether the viewer's hello is still pending.
  bool is_silent() const { return !welcomed_ && !ending_ && !removed_; }
  bool is_ending() const { return ending_; }
  bool receives_deformation() const { return receives_deformation_ && !ending_; }
  bool receives_training() const { return receives_training_ && !ending_; }
  bool receives_navigation() const { return receives_navigation_ && !ending_; }
  Clock::time_point hello_by() const { return hello_by_; }
  const AuthenticatedViewer& who() const { return who_; }
  /// Invalidates the received sweeps beyond `count`, after an undo.
  void truncate_sweeps(std::uint64_t count) { sweeps_sent_.count = std::min(sweeps_sent_.count, count); }
  /// Sets the viewer's number, unique within this server.
  void set_number(std::uint32_t number) { number_ = number; }
  ViewerIdentity identity() const {
    return {number_, is_permitted(who_.role, Permission::kOperateTool, true), who_.learner,
            is_permitted(who_.role, Permission::kLesson, true)};
  }

 private:
  void read();
  void read_failed(WebSocket::Read outcome);
  void on_message(std::string_view text, WebSocket::Read outcome);
  void handle(const std::optional<ViewerMessage>& message);
  void handle(const Request& request);
  void handle_hello(const Hello& hello);
  void write_next();
  bool next_sweeps();
  bool next_ticks();
  bool next_deformation();
  bool next_training();
  bool next_plan();
  bool next_navigation();
  void defer_deformation();
  /// @param bytes  have to stay valid until the write has finished
  void write(std::string_view bytes, bool binary);
  void write_failed();
  bool exceeds_rate_limit();

  std::shared_ptr<WebSocket> socket_;
  Hub& hub_;
  const std::string peer_;
  const AddressBlock from_;
  TokenBucket messages_;

  bool open_ = false, welcomed_ = false, ending_ = false, removed_ = false, reading_ = false,
       writing_ = false;
  AuthenticatedViewer who_;
  std::uint32_t number_ = 0;
  std::optional<std::uint16_t> finish_code_;  ///< Close code of finish(); empty until it is called
  Clock::time_point hello_by_, end_by_, write_started_;
  Clock::duration pose_period_{};
  Clock::time_point next_pose_{};

  std::deque<std::string> answers_;
  bool has_dropped_requests_ = false;  // whether requests were dropped because the answer queue was full
  bool state_due_ = false, pose_due_ = false, pose_is_next_ = false;
  SentSweeps sweeps_sent_;
  bool receives_deformation_ = false, deformation_in_flight_ = false;
  /// PublishedDeformation::number; 0: none shown
  std::array<std::uint64_t, kMaxDevices> deformations_sent_{};
  std::size_t next_deformed_device_ = 0;  ///< next device in round-robin order
  Clock::time_point next_deformation_allowed_{};
  std::shared_ptr<const std::string> deformation_message_;
  bool receives_plan_ = false;
  std::shared_ptr<const std::string> plan_sent_;
  bool receives_navigation_ = false;
  std::shared_ptr<const std::string> navigation_sent_;
  bool receives_training_ = false, training_due_ = false;
  std::shared_ptr<const std::string> debriefing_sent_;
  std::uint64_t sequence_ = 0;
  PoseMessage pose_, pose_in_flight_;
  bool receives_distances_ = false, distances_due_ = false;
  std::optional<DistanceMessage> near_;
  DistanceMessage near_in_flight_;
  bool receives_ticks_ = false, ticks_due_ = false, is_bundle_in_flight_ = false;
  SentTicks ticks_sent_;
  BundleLimit bundle_limit_;
  std::string bundle_in_flight_;
  std::string text_in_flight_;
};

}  // namespace palpate::server
