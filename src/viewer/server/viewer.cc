#include "server/viewer.h"

#include <utility>

#include "server/hub.h"

namespace palpate::server {
namespace {

static_assert(WebSocket::kMaxMessage_bytes == kMaxMessage_bytes);

constexpr auto kHelloTimeout = std::chrono::seconds(5);
constexpr auto kSendTimeout = std::chrono::seconds(10);
constexpr auto kCloseTimeout = std::chrono::seconds(2);
constexpr double kMaxMessages_each_second = 250;
// maximum number of queued answers; further requests are ignored
constexpr std::size_t kMaxAnswers = 32;
// close codes of RFC 6455, and private ones: 4000 and above are reserved for applications
constexpr std::uint16_t kUnknownData = 1003, kBadPayload = 1007, kPolicyError = 1008, kInternalError = 1011;
constexpr std::uint16_t kTokenRefused = 4401, kProtocolUnknown = 4406, kNoHello = 4408,
                        kTooManyGuesses = 4429;

// message for tissue at rest
PublishedDeformation message_at_rest(std::size_t device) {
  return {0, true, std::make_shared<const std::string>(DeformationMessage(device, nullptr).bytes())};
}

}  // namespace

Viewer::Viewer(std::shared_ptr<WebSocket> socket, std::string peer, const AddressBlock& from, Hub& hub)
    : socket_(std::move(socket)),
      hub_(hub),
      peer_(std::move(peer)),
      from_(from),
      messages_(kMaxMessages_each_second, kMaxMessages_each_second, Clock::now()),
      hello_by_(Clock::now() + kHelloTimeout) {}

void Viewer::begin() {
  reading_ = true;
  // control frames count as messages, since each costs an answer; the socket does not keep this viewer alive
  const auto on_control = [viewer = weak_from_this()] {
    if (const auto self = viewer.lock()) self->exceeds_rate_limit();
  };
  socket_->accept(on_control, [self = shared_from_this()](bool ok) {
    self->reading_ = false;
    if (!ok) return self->remove_from_hub();
    self->open_ = true;
    self->read();
  });
}

// ---- input

void Viewer::read() {
  if (reading_ || ending_ || removed_) return;
  socket_->read([self = shared_from_this()](WebSocket::Read outcome, std::string_view text) {
    self->reading_ = false;
    self->on_message(text, outcome);
    self->read();
  });
  // set only after read() succeeded: if it throws (out of memory), the next periodic check retries
  reading_ = true;
}

bool Viewer::exceeds_rate_limit() {
  if (messages_.take(Clock::now())) return false;
  end(kPolicyError, "too many messages");
  return true;
}

// an internal error closes the viewer instead of leaving it without a pending read
void Viewer::on_message(std::string_view text, WebSocket::Read outcome) try {
  const auto message = parse_viewer_message(text);
  // a stop is carried out before anything that might end this viewer
  const bool stop = welcomed_ && is_stop(message);
  if (stop) handle(std::get<Request>(*message));
  if (outcome == WebSocket::Read::kBinary) return end(kUnknownData, "a binary message");
  if (outcome != WebSocket::Read::kText) return read_failed(outcome);
  if (!exceeds_rate_limit() && !stop) handle(message);
} catch (const std::exception&) {
  end(kInternalError, "an internal server error");
}

void Viewer::read_failed(WebSocket::Read outcome) {
  if (!ending_ && outcome == WebSocket::Read::kMalformed)
    hub_.log().add(peer_, "a frame that is malformed or too long");
  remove_from_hub();
}

void Viewer::handle(const std::optional<ViewerMessage>& message) {
  if (!message) return end(kBadPayload, "a message that is malformed");
  const auto* hello = std::get_if<Hello>(&*message);
  if ((hello != nullptr) == welcomed_) return end(kPolicyError, "a message out of turn");
  if (hello) return handle_hello(*hello);
  if (const auto* tip = std::get_if<TipMessage>(&*message)) return hub_.move_pointer(*this, *tip);
  handle(std::get<Request>(*message));
}

void Viewer::handle(const Request& request) {
  // without room for its answer a request is not carried out, except for a stop
  const bool room = answers_.size() < kMaxAnswers;
  if (!room && !std::holds_alternative<StopRequest>(request.body)) {
    if (!std::exchange(has_dropped_requests_, true))
      hub_.log().add(peer_, "receives no answers, so its requests are refused");
    return;
  }
  std::string answer = hub_.answer(*this, request);
  // the answer precedes the state that it changed
  if (room) send(std::move(answer));
  has_dropped_requests_ = has_dropped_requests_ && !room;
  hub_.publish_state();
}

void Viewer::handle_hello(const Hello& hello) {
  if (hello.protocol != kProtocolVersion) return end(kProtocolUnknown, "another version of the protocol");
  auto admitted = hub_.site().access().admit(hello.token, from_, Clock::now());
  if (admitted.too_many_guesses) return end(kTooManyGuesses, "a token after too many wrong ones");
  if (!admitted.who) return end(kTokenRefused, "a wrong token or none");
  if (!hub_.make_room_for_viewer(admitted.who->role)) return end(kTryAgainLater, "too many viewers");
  who_ = *std::move(admitted.who);
  welcomed_ = true;
  receives_deformation_ = hello.wants_deformation;
  receives_training_ = hello.wants_task;
  receives_distances_ = hello.wants_distances;
  receives_plan_ = hello.wants_plan;
  receives_navigation_ = hello.wants_navigation;
  receives_ticks_ = hello.wants_ticks && hub_.tick_history() != nullptr;
  if (receives_ticks_) ticks_sent_.next = hub_.tick_history()->count();
  pose_period_ =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / hello.poses_hz));
  send(hub_.welcome_for(who_));
  hub_.welcome(*this);
}

// ---- output

void Viewer::send(std::string text) {
  answers_.push_back(std::move(text));
  write_next();
}

void Viewer::notify_state() {
  if (!welcomed_) return;
  state_due_ = true;
  write_next();
}

void Viewer::notify_deformation() {
  if (welcomed_ && receives_deformation_) write_next();
}

void Viewer::notify_training() {
  if (!welcomed_ || !receives_training_) return;
  training_due_ = true;
  write_next();
}

void Viewer::notify_plan() {
  if (welcomed_ && receives_plan_) write_next();
}

void Viewer::notify_navigation() {
  if (welcomed_ && receives_navigation_) write_next();
}

bool Viewer::is_due(Clock::time_point now) const {
  // round to the nearest period
  constexpr auto kHalfPosePeriod = std::chrono::microseconds(static_cast<int>(0.5e6 / kMaxPoses_hz));
  return welcomed_ && !ending_ && now + kHalfPosePeriod >= next_pose_;
}

void Viewer::enqueue_pose(const PoseMessage& pose, const DistanceMessage* near, Clock::time_point now) {
  // a viewer behind its rate does not catch up
  next_pose_ = std::max(next_pose_ + pose_period_, now);
  pose_ = pose;
  pose_.set_sequence(++sequence_);
  pose_due_ = true;
  ticks_due_ = receives_ticks_;
  if (receives_distances_ && near && !(near_ && near->equals_except_tick(*near_))) {
    near_ = *near;
    distances_due_ = true;
  }
  write_next();
}

// Priority: answers, state, plan; then navigation, training, sweeps, deformation and ticks, at most one of
// these between two poses; then the distances, before the pose of their tick, and the pose.
void Viewer::write_next() {
  if (writing_ || ending_ || removed_) return;
  if (!answers_.empty()) {
    text_in_flight_ = std::move(answers_.front());
    answers_.pop_front();
    write(text_in_flight_, false);
  } else if (std::exchange(state_due_, false)) {
    text_in_flight_ = hub_.state_for(*this);
    write(text_in_flight_, false);
  } else if (next_plan()) {
    write(text_in_flight_, false);
  } else if (!(pose_due_ && pose_is_next_) && next_navigation()) {
    pose_is_next_ = true;
    write(text_in_flight_, false);
  } else if (!(pose_due_ && pose_is_next_) && next_training()) {
    pose_is_next_ = true;
    write(text_in_flight_, false);
  } else if (!(pose_due_ && pose_is_next_) && next_sweeps()) {
    pose_is_next_ = true;
    write(text_in_flight_, false);
  } else if (!(pose_due_ && pose_is_next_) && next_deformation()) {
    pose_is_next_ = true;
    write(*deformation_message_, true);
  } else if (!(pose_due_ && pose_is_next_) && next_ticks()) {
    pose_is_next_ = true;
    write(bundle_in_flight_, true);
  } else if (std::exchange(distances_due_, false)) {
    near_in_flight_ = *near_;
    write(near_in_flight_.bytes(), true);
  } else if (std::exchange(pose_due_, false)) {
    pose_is_next_ = false;
    pose_in_flight_ = pose_;
    write(pose_in_flight_.bytes(), true);
  } else if (finish_code_) {
    end(*finish_code_, "");
  }
}

// sweeps and poses are sent alternately
bool Viewer::next_sweeps() {
  std::string text = welcomed_ ? hub_.sweeps_after(sweeps_sent_) : std::string();
  if (text.empty()) return false;
  text_in_flight_ = std::move(text);
  return true;
}

// one bundle for each pose that is due; alternates with poses
bool Viewer::next_ticks() {
  if (!std::exchange(ticks_due_, false)) return false;
  const TickHistory& history = *hub_.tick_history();
  // the ticks of a redacted session stay redacted when the redaction ends
  if (hub_.redaction_of(*this) != nullptr) {
    ticks_sent_.next = history.count();
    return false;
  }
  is_bundle_in_flight_ = next_bundle(history, ticks_sent_, hub_.bundle_scratch().first(bundle_limit_.ticks()),
                                     bundle_in_flight_);
  return is_bundle_in_flight_;
}

// rarely changes
bool Viewer::next_plan() {
  if (!welcomed_ || !receives_plan_) return false;
  const auto reported = hub_.published_plan(*this);
  if (plan_sent_ == reported) return false;
  plan_sent_ = reported;
  if (!plan_sent_) return false;
  text_in_flight_ = *plan_sent_;
  return true;
}

// alternates with poses
bool Viewer::next_navigation() {
  if (!welcomed_ || !receives_navigation_ || navigation_sent_ == hub_.published_navigation()) return false;
  navigation_sent_ = hub_.published_navigation();
  text_in_flight_ = *navigation_sent_;
  return true;
}

// the debriefing precedes the message that the run is over; alternates with poses
bool Viewer::next_training() {
  if (!welcomed_ || !receives_training_) return false;
  if (auto reported = hub_.published_debriefing(*this); debriefing_sent_ != reported) {
    debriefing_sent_ = std::move(reported);
    if (debriefing_sent_) {
      text_in_flight_ = *debriefing_sent_;
      return true;
    }
  }
  if (!std::exchange(training_due_, false) || hub_.published_training(*this).empty()) return false;
  text_in_flight_ = hub_.published_training(*this);
  return true;
}

// latest message of one device; alternates with poses
bool Viewer::next_deformation() {
  if (!welcomed_ || !receives_deformation_ || Clock::now() < next_deformation_allowed_) return false;
  for (std::size_t n = 0; n < deformations_sent_.size(); ++n) {
    const std::size_t device =
        std::exchange(next_deformed_device_, (next_deformed_device_ + 1) % kMaxDevices);
    // the deformation of tissue reveals its structure
    const bool is_redacted = hub_.redaction_of(*this) != nullptr;
    if (is_redacted && deformations_sent_[device] == 0) continue;
    const PublishedDeformation published =
        is_redacted ? message_at_rest(device) : hub_.published_deformation(device);
    const std::uint64_t last_sent = std::exchange(deformations_sent_[device], published.number);
    // a viewer that has received nothing assumes tissue at rest
    if (last_sent == published.number || (last_sent == 0 && published.rests)) continue;
    deformation_message_ = published.bytes;
    deformation_in_flight_ = true;
    return true;
  }
  return false;
}

// on a slow connection, poses have priority
void Viewer::defer_deformation() {
  const Clock::time_point now = Clock::now();
  next_deformation_allowed_ = now + 2 * (now - write_started_);
}

void Viewer::write(std::string_view bytes, bool binary) {
  writing_ = true;
  write_started_ = Clock::now();
  socket_->write(bytes, binary, [self = shared_from_this()](bool ok) {
    self->writing_ = false;
    if (!ok) return self->write_failed();
    if (std::exchange(self->deformation_in_flight_, false)) self->defer_deformation();
    if (std::exchange(self->is_bundle_in_flight_, false))
      self->bundle_limit_.on_sent(Clock::now() - self->write_started_);
    self->write_next();
  });
}

// a pending read may still receive the viewer's reason for closing: allow it some time
void Viewer::write_failed() {
  if (!reading_) return remove_from_hub();
  if (std::exchange(ending_, true)) return;
  end_by_ = Clock::now() + kCloseTimeout;
}

// ---- the end

void Viewer::end(std::uint16_t code, std::string_view fault) {
  if (removed_ || std::exchange(ending_, true)) return;
  if (!fault.empty()) hub_.log().add(peer_, fault);
  // a WebSocket cannot send a close frame before it is open
  if (!open_) return remove_from_hub();
  end_by_ = Clock::now() + kCloseTimeout;
  socket_->close(code, [self = shared_from_this()] { self->remove_from_hub(); });
}

void Viewer::finish(std::uint16_t code) {
  finish_code_ = code;
  write_next();
}

void Viewer::check(Clock::time_point now) {
  if (ending_) {
    if (now >= end_by_) remove_from_hub();
  } else if (!welcomed_ && now >= hello_by_) {
    end(kNoHello, "no hello");
  } else if (writing_ && now >= write_started_ + kSendTimeout) {
    hub_.log().add(peer_, "receives nothing");
    remove_from_hub();
  } else if (open_) {
    read();
  }
}

void Viewer::remove_from_hub() {
  if (std::exchange(removed_, true)) return;
  socket_->drop();
  hub_.remove(shared_from_this());
}

}  // namespace palpate::server
