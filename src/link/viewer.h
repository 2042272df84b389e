#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "link/address.h"
#include "link/near_message.h"
#include "link/pose_message.h"
#include "link/request.h"
#include "link/scene_json.h"
#include "link/token_bucket.h"
#include "link/transport.h"
#include "palpate/device/telemetry.h"

namespace palpate::link {

class Hub;

/// What a viewer has had of the sweeps.
struct SweepsHad {
  std::uint64_t count = 0;  ///< how many of those that it got still stand
  std::uint64_t shown =
      0;  ///< how many its page shows; those beyond `count` were undone, and it must drop them
};

// close codes of RFC 6455's registry
inline constexpr std::uint16_t kGoingAway = 1001, kTryAgainLater = 1013;

/// One viewer's WebSocket. What it is sent waits here, never in the hub and never more than this:
///
///     answers_     texts, in order; when there are many, nothing but a stop is done until some were taken
///     state_due_   the state as it is when its turn comes
///     pose_        the latest, which replaces one that was not sent
///     near_        the latest of what is near, likewise; it goes out before the pose with which it came
///     training_due_, debriefing_due_  how far a run of a task is, and the last one's figures, likewise
///     plan_had_    which text it has of the plan; the hub has the newest
///     navigation_had_  which text it has of how wrong a tracked tip's place may be, likewise
///     yields_had_  which message it has of the tissue around each device; the hub has the newest
///
/// One write is under way at a time. A viewer that reads slowly thereby loses what it asks for and nothing
/// else; the system's buffer for its connection is small, so that what does arrive is not old.
class Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param peer, from  the viewer's address, HttpConnection::peer() and from()
  Viewer(std::shared_ptr<WebSocket> socket, std::string peer, const AddressBlock& from, Hub& hub);

  void begin();
  /// Closes what takes too long.
  void check(Clock::time_point now);
  /// Offers a pose; taken where the viewer's own rate says that one is due.
  bool is_due(Clock::time_point now) const;
  /// @param near  of the same tick; null: the scene tells nothing of it
  void show(const PoseMessage& pose, const NearMessage* near, Clock::time_point now);
  void show_state();
  /// There may be something new of how tissue has yielded.
  void show_yields();
  /// There is something new of a run of a task.
  void show_training();
  /// There is something new of how wrong a tracked tip's place may be.
  void show_navigation();
  /// The plan is another one.
  void show_plan();
  /// An answer.
  void say(std::string text);
  /// Says goodbye with a close code, and why to the log.
  void end(std::uint16_t code, std::string_view fault);
  /// Leaves the hub, without a goodbye or after it.
  void gone();

  bool welcomed() const { return welcomed_; }
  /// Has not said hello, and still may.
  bool is_silent() const { return !welcomed_ && !ending_ && !gone_; }
  bool is_ending() const { return ending_; }
  bool wants_yields() const { return wants_yields_ && !ending_; }
  bool wants_training() const { return wants_training_ && !ending_; }
  bool wants_navigation() const { return wants_navigation_ && !ending_; }
  Clock::time_point hello_by() const { return hello_by_; }
  const Who& who() const { return who_; }
  /// Of the sweeps that it has had only so many are still there.
  void keep_sweeps(std::uint64_t count) { sweeps_had_.count = std::min(sweeps_had_.count, count); }
  /// Its own among all that say hello to this server.
  void get_number(std::uint32_t number) { number_ = number; }
  ViewerIdentity identity() const { return {number_, may(who_.role, Right::kHand, true)}; }

 private:
  void read();
  void read_failed(WebSocket::Read outcome);
  void take_whole(std::string_view text, WebSocket::Read outcome);
  void take(const std::optional<ViewerMessage>& message);
  void take(const Request& request);
  void greet(const Hello& hello);
  void write_next();
  bool next_sweeps();
  bool next_yield();
  bool next_training();
  bool next_plan();
  bool next_navigation();
  void rest_from_yields();
  /// @param bytes  stay as they are until it is done
  void write(std::string_view bytes, bool binary);
  void write_failed();
  bool too_many();

  std::shared_ptr<WebSocket> socket_;
  Hub& hub_;
  const std::string peer_;
  const AddressBlock from_;
  TokenBucket messages_;

  bool open_ = false, welcomed_ = false, ending_ = false, gone_ = false, reading_ = false, writing_ = false;
  Who who_;
  std::uint32_t number_ = 0;
  Clock::time_point hello_by_, end_by_, write_begun_;
  Clock::duration pose_period_{};
  Clock::time_point next_pose_{};

  std::deque<std::string> answers_;
  bool deaf_ = false;  // has left requests undone, their answers having no place
  bool state_due_ = false, pose_due_ = false, pose_is_next_ = false;
  SweepsHad sweeps_had_;
  bool wants_yields_ = false, yield_is_out_ = false;
  std::array<std::uint64_t, kMaxDevices> yields_had_{};  ///< ToldYield::number; 0: it shows none
  std::size_t next_yielding_ = 0;                        ///< device whose turn it is
  Clock::time_point no_yield_before_{};
  std::shared_ptr<const std::string> yield_out_;
  bool wants_plan_ = false;
  std::shared_ptr<const std::string> plan_had_;
  bool wants_navigation_ = false;
  std::shared_ptr<const std::string> navigation_had_;
  bool wants_training_ = false, training_due_ = false;
  std::shared_ptr<const std::string> debriefing_had_;
  std::uint64_t sequence_ = 0;
  PoseMessage pose_, pose_out_;
  bool wants_near_ = false, near_due_ = false;
  std::optional<NearMessage> near_;
  NearMessage near_out_;
  std::string text_out_;
};

}  // namespace palpate::link
