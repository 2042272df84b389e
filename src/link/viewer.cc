#include "link/viewer.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/http/field.hpp>
#include <utility>

#include "link/hub.h"

namespace palpate::link {
namespace {

namespace websocket = beast::websocket;

constexpr auto kHelloWithin = std::chrono::seconds(5);
constexpr auto kReadWithin = std::chrono::seconds(10);
constexpr auto kLeaveWithin = std::chrono::seconds(2);
constexpr double kMostMessages_each_second = 250;
// so many answers may wait before no more requests are taken
constexpr std::size_t kMostAnswers = 32;
// close codes of ours, 4000 and above as RFC 6455 leaves them to applications
constexpr std::uint16_t kTokenRefused = 4401, kProtocolUnknown = 4406, kNoHello = 4408,
                        kTooManyGuesses = 4429;

// What waits in the system for a viewer that does not read is old when it does: keep that small, and send
// small messages at once.
void keep_fresh(Stream::Socket& socket) {
  const int handle = socket.native_handle();
  const int on = 1, buffer_bytes = 16 << 10, unsent_bytes = 2 << 10;
  // none of these is needed for anything but speed
  ::setsockopt(handle, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  ::setsockopt(handle, SOL_SOCKET, SO_SNDBUF, &buffer_bytes, sizeof buffer_bytes);
  ::setsockopt(handle, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent_bytes, sizeof unsent_bytes);
}

// nothing has yielded
ToldYield untold_yield(std::size_t device) {
  return {0, true, std::make_shared<const std::string>(YieldMessage(device, nullptr).bytes())};
}

}  // namespace

Viewer::Viewer(std::unique_ptr<Stream> stream, Hub& hub)
    : stream_(std::move(stream)),
      hub_(hub),
      peer_(peer_of(*stream_)),
      from_(block_of(*stream_)),
      socket_(*stream_),
      messages_(kMostMessages_each_second, kMostMessages_each_second, Clock::now()),
      hello_by_(Clock::now() + kHelloWithin) {}

void Viewer::begin(UpgradeRequest request) {
  keep_fresh(stream_->socket());
  // the hub's sweep watches the time
  socket_.set_option(
      websocket::stream_base::timeout{websocket::stream_base::none(), websocket::stream_base::none(), false});
  socket_.set_option(websocket::stream_base::decorator([](websocket::response_type& response) {
    response.set(beast::http::field::sec_websocket_protocol, "palpate.v1");
    response.erase(beast::http::field::server);
  }));
  socket_.read_message_max(kMostMessage_bytes);
  socket_.auto_fragment(false);
  // pings cost an answer each. This is called in the middle of a read, where no goodbye can begin
  socket_.control_callback([this](websocket::frame_type, beast::string_view) {
    net::post(stream_->get_executor(), [self = shared_from_this()] { self->too_many(); });
  });
  request_ = std::move(request);
  reading_ = true;
  socket_.async_accept(request_, [self = shared_from_this()](ErrorCode failed) {
    self->reading_ = false;
    if (failed) return self->gone();
    self->open_ = true;
    self->request_ = {};
    self->read();
  });
}

// ---- what comes in

void Viewer::read() {
  if (reading_ || ending_ || gone_) return;
  socket_.async_read(input_, [self = shared_from_this()](ErrorCode failed, std::size_t) {
    self->reading_ = false;
    const auto bytes = self->input_.data();
    self->take_whole({static_cast<const char*>(bytes.data()), bytes.size()}, failed);
    self->input_.consume(self->input_.size());
    self->read();
  });
  // no sooner: what could not begin for want of memory, the next sweep begins
  reading_ = true;
}

bool Viewer::too_many() {
  if (messages_.take(Clock::now())) return false;
  end(websocket::close_code::policy_error, "too many messages");
  return true;
}

// no error of ours leaves a viewer that is never heard again
void Viewer::take_whole(std::string_view text, ErrorCode failed) try {
  const auto message = parse_viewer_message(text);
  // a stop comes before whatever ends this viewer
  const bool stop = welcomed_ && is_stop(message);
  if (stop) take(std::get<Request>(*message));
  if (failed) return read_failed(failed);
  if (socket_.got_binary()) return end(websocket::close_code::unknown_data, "a binary message");
  if (!too_many() && !stop) take(message);
} catch (const std::exception&) {
  end(websocket::close_code::internal_error, "an error of the server's own");
}

void Viewer::read_failed(ErrorCode failed) {
  if (!ending_ && failed != websocket::error::closed && failed != net::error::eof &&
      failed.category() == ErrorCode(websocket::error::closed).category())
    hub_.log().say(peer_, "a frame that is malformed or too long");
  gone();
}

void Viewer::take(const std::optional<ViewerMessage>& message) {
  if (!message) return end(websocket::close_code::bad_payload, "a message that is malformed");
  const auto* hello = std::get_if<Hello>(&*message);
  if ((hello != nullptr) == welcomed_)
    return end(websocket::close_code::policy_error, "a message out of turn");
  if (hello) return greet(*hello);
  if (const auto* tip = std::get_if<TipMessage>(&*message)) return hub_.move_pointer(*this, *tip);
  take(std::get<Request>(*message));
}

void Viewer::take(const Request& request) {
  // what finds no place for its answer is not done, a stop excepted
  const bool room = answers_.size() < kMostAnswers;
  if (!room && !std::holds_alternative<StopRequest>(request.what)) {
    if (!std::exchange(deaf_, true)) hub_.log().say(peer_, "takes no answers, its requests are not granted");
    return;
  }
  std::string answer = hub_.answer(*this, request);
  // first the answer, then what it changed
  if (room) say(std::move(answer));
  deaf_ = deaf_ && !room;
  hub_.look_at_state();
}

void Viewer::greet(const Hello& hello) {
  if (hello.protocol != kProtocol) return end(kProtocolUnknown, "another version of the protocol");
  auto admitted = hub_.site().access().admit(hello.token, from_, Clock::now());
  if (admitted.too_many_guesses) return end(kTooManyGuesses, "a token after too many wrong ones");
  if (!admitted.who) return end(kTokenRefused, "a wrong token or none");
  if (!hub_.make_room_for_viewer(admitted.who->role)) return end(kTryAgainLater, "too many viewers");
  who_ = *std::move(admitted.who);
  welcomed_ = true;
  wants_yields_ = hello.yielded;
  wants_training_ = hello.task;
  wants_near_ = hello.near;
  wants_plan_ = hello.plan;
  wants_navigation_ = hello.navigation;
  pose_period_ =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / hello.poses_hz));
  say(hub_.welcome_for(who_));
  hub_.welcome(*this);
}

// ---- what goes out

void Viewer::say(std::string text) {
  answers_.push_back(std::move(text));
  write_next();
}

void Viewer::show_state() {
  if (!welcomed_) return;
  state_due_ = true;
  write_next();
}

void Viewer::show_yields() {
  if (welcomed_ && wants_yields_) write_next();
}

void Viewer::show_training() {
  if (!welcomed_ || !wants_training_) return;
  training_due_ = true;
  write_next();
}

void Viewer::show_plan() {
  if (welcomed_ && wants_plan_) write_next();
}

void Viewer::show_navigation() {
  if (welcomed_ && wants_navigation_) write_next();
}

bool Viewer::is_due(Clock::time_point now) const {
  // half a turn early is nearer than half a turn late
  constexpr auto kHalfTurn = std::chrono::microseconds(static_cast<int>(0.5e6 / kMostPoses_hz));
  return welcomed_ && !ending_ && now + kHalfTurn >= next_pose_;
}

void Viewer::show(const PoseMessage& pose, const NearMessage* near, Clock::time_point now) {
  // one that has fallen behind its rate does not catch up
  next_pose_ = std::max(next_pose_ + pose_period_, now);
  pose_ = pose;
  pose_.set_sequence(++sequence_);
  pose_due_ = true;
  if (wants_near_ && near && !(near_ && near->says_the_same(*near_))) {
    near_ = *near;
    near_due_ = true;
  }
  write_next();
}

void Viewer::write_next() {
  if (writing_ || ending_ || gone_) return;
  if (!answers_.empty()) {
    text_out_ = std::move(answers_.front());
    answers_.pop_front();
    write(net::buffer(text_out_), false);
  } else if (std::exchange(state_due_, false)) {
    text_out_ = hub_.state_for(*this);
    write(net::buffer(text_out_), false);
  } else if (next_plan()) {
    write(net::buffer(text_out_), false);
  } else if (!(pose_due_ && pose_is_next_) && next_navigation()) {
    pose_is_next_ = true;
    write(net::buffer(text_out_), false);
  } else if (!(pose_due_ && pose_is_next_) && next_training()) {
    pose_is_next_ = true;
    write(net::buffer(text_out_), false);
  } else if (!(pose_due_ && pose_is_next_) && next_sweeps()) {
    pose_is_next_ = true;
    write(net::buffer(text_out_), false);
  } else if (!(pose_due_ && pose_is_next_) && next_yield()) {
    pose_is_next_ = true;
    write(net::buffer(*yield_out_), true);
  } else if (std::exchange(near_due_, false)) {
    near_out_ = *near_;
    write(net::buffer(near_out_.bytes()), true);
  } else if (std::exchange(pose_due_, false)) {
    pose_is_next_ = false;
    pose_out_ = pose_;
    write(net::buffer(pose_out_.bytes()), true);
  }
}

// what was cut goes out in turns with poses
bool Viewer::next_sweeps() {
  std::string text = welcomed_ ? hub_.sweeps_after(sweeps_had_) : std::string();
  if (text.empty()) return false;
  text_out_ = std::move(text);
  return true;
}

// it changes by hand, seldom
bool Viewer::next_plan() {
  if (!welcomed_ || !wants_plan_ || plan_had_ == hub_.told_plan()) return false;
  plan_had_ = hub_.told_plan();
  if (!plan_had_) return false;
  text_out_ = *plan_had_;
  return true;
}

// in turns with poses
bool Viewer::next_navigation() {
  if (!welcomed_ || !wants_navigation_ || navigation_had_ == hub_.told_navigation()) return false;
  navigation_had_ = hub_.told_navigation();
  text_out_ = *navigation_had_;
  return true;
}

// the figures of a run before it is told that it is over; in turns with poses
bool Viewer::next_training() {
  if (!welcomed_ || !wants_training_) return false;
  if (auto told = hub_.told_debriefing(*this); debriefing_had_ != told) {
    debriefing_had_ = std::move(told);
    if (debriefing_had_) {
      text_out_ = *debriefing_had_;
      return true;
    }
  }
  if (!std::exchange(training_due_, false) || hub_.told_training().empty()) return false;
  text_out_ = hub_.told_training();
  return true;
}

// the newest of one device, in turns with poses
bool Viewer::next_yield() {
  if (!welcomed_ || !wants_yields_ || Clock::now() < no_yield_before_) return false;
  for (std::size_t n = 0; n < yields_had_.size(); ++n) {
    const std::size_t device = std::exchange(next_yielding_, (next_yielding_ + 1) % kMaxDevices);
    // how tissue goes shows what is in it
    const bool is_veiled = hub_.veil_of(*this) != nullptr;
    if (is_veiled && yields_had_[device] == 0) continue;
    const ToldYield told = is_veiled ? untold_yield(device) : hub_.told_yield(device);
    const std::uint64_t had = std::exchange(yields_had_[device], told.number);
    // that nothing has yielded one knows that has heard of nothing else
    if (had == told.number || (had == 0 && told.rests)) continue;
    yield_out_ = told.bytes;
    yield_is_out_ = true;
    return true;
  }
  return false;
}

// poses have most of a connection that is slow
void Viewer::rest_from_yields() {
  const Clock::time_point now = Clock::now();
  no_yield_before_ = now + 2 * (now - write_begun_);
}

void Viewer::write(net::const_buffer bytes, bool binary) {
  writing_ = true;
  write_begun_ = Clock::now();
  socket_.binary(binary);
  socket_.async_write(bytes, [self = shared_from_this()](ErrorCode failed, std::size_t) {
    self->writing_ = false;
    if (failed) return self->write_failed();
    if (std::exchange(self->yield_is_out_, false)) self->rest_from_yields();
    self->write_next();
  });
}

// A read that is under way may be telling the viewer why it ends: it gets its time.
void Viewer::write_failed() {
  if (!reading_) return gone();
  if (std::exchange(ending_, true)) return;
  end_by_ = Clock::now() + kLeaveWithin;
}

// ---- the end

void Viewer::end(std::uint16_t code, std::string_view fault) {
  if (gone_ || std::exchange(ending_, true)) return;
  if (!fault.empty()) hub_.log().say(peer_, fault);
  // there is nobody to say goodbye to yet, and Beast's streams cannot close while they open
  if (!open_) return gone();
  end_by_ = Clock::now() + kLeaveWithin;
  socket_.async_close(websocket::close_reason(static_cast<websocket::close_code>(code)),
                      [self = shared_from_this()](ErrorCode) { self->gone(); });
}

void Viewer::check(Clock::time_point now) {
  if (ending_) {
    if (now >= end_by_) gone();
  } else if (!welcomed_ && now >= hello_by_) {
    end(kNoHello, "no hello");
  } else if (writing_ && now >= write_begun_ + kReadWithin) {
    hub_.log().say(peer_, "takes nothing");
    gone();
  } else if (open_) {
    read();
  }
}

void Viewer::gone() {
  if (std::exchange(gone_, true)) return;
  stream_->close();
  hub_.remove(shared_from_this());
}

}  // namespace palpate::link
