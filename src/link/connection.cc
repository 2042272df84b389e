#include "link/connection.h"

#include <array>
#include <boost/asio/write.hpp>
#include <boost/beast/http/error.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/rfc7230.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <limits>
#include <utility>

#include "link/hub.h"
#include "link/viewer.h"

namespace palpate::link {
namespace {

namespace http = beast::http;

// for the first request, TLS included; a later one may come after a while
constexpr auto kFirstHeadWithin = std::chrono::seconds(5), kNextHeadWithin = std::chrono::seconds(15);
// so much of an answer, or what is left of it: who takes less keeps a place that others may need
constexpr std::size_t kTaken_bytes = 64 << 10;
constexpr auto kTakenWithin = std::chrono::seconds(10);
constexpr auto kMadeWithin = std::chrono::seconds(60);
constexpr auto kLingers = std::chrono::seconds(1);

// as a viewer writes it: an IPv4 address that came by an IPv6 socket is itself, and a scope is our own affair
std::string as_asked_for(const boost::asio::ip::address& address) {
  if (!address.is_v6()) return address.to_string();
  boost::asio::ip::address_v6 v6 = address.to_v6();
  if (v6.is_v4_mapped()) return boost::asio::ip::make_address_v4(boost::asio::ip::v4_mapped, v6).to_string();
  v6.scope_id(0);
  return v6.to_string();
}

std::string_view view(beast::string_view text) {
  return {text.data(), text.size()};
}

}  // namespace

Connection::Connection(std::unique_ptr<Stream> stream, Hub& hub)
    : stream_(std::move(stream)),
      hub_(hub),
      peer_(peer_of(*stream_)),
      from_(block_of(*stream_)),
      turn_(stream_->get_executor()),
      since_(Clock::now()),
      close_by_(since_ + kFirstHeadWithin) {
  ErrorCode failed;
  const auto local = stream_->socket().local_endpoint(failed);
  if (!failed) local_address_ = as_asked_for(local.address());
}

void Connection::begin() {
  if (!stream_->is_tls()) return read();
  stream_->async_handshake([self = shared_from_this()](ErrorCode failed) {
    if (!failed) return self->read();
    self->hub_.log().say(self->peer_, "no TLS");
    self->close();
  });
}

void Connection::read() {
  if (closed_) return;
  about_ = About::kSilent;
  // it looks into the parser
  request_ = {};
  parser_.emplace();
  parser_->header_limit(kMostHead_bytes);
  // a body is refused when it is known who asks, and never read
  parser_->body_limit(std::numeric_limits<std::uint64_t>::max());
  http::async_read_header(*stream_, input_, *parser_,
                          [self = shared_from_this()](ErrorCode failed, std::size_t head_bytes) {
                            if (self->closed_) return;
                            self->about_ = About::kTaking;
                            // the parser's own limit leaves some of the ends of lines out
                            if (!failed && head_bytes > kMostHead_bytes) failed = http::error::header_limit;
                            if (failed) return self->read_failed(failed);
                            self->serve();
                          });
}

void Connection::read_failed(ErrorCode failed) {
  const bool too_long = failed == http::error::header_limit || failed == http::error::buffer_overflow;
  const bool malformed = failed.category() == ErrorCode(http::error::bad_version).category();
  if (failed == http::error::end_of_stream || failed == http::error::partial_message || !malformed)
    return close();
  hub_.log().say(peer_, too_long ? "a request head that is too long" : "a malformed request");
  send(Site::refusal(too_long ? 431 : 400), false);
}

void Connection::serve() {
  const auto& head = parser_->get();
  request_.method = view(head.method_string());
  request_.target = view(head.target());
  request_.host = view(head[http::field::host]);
  request_.origin = view(head[http::field::origin]);
  request_.fetch_site = view(head["Sec-Fetch-Site"]);
  request_.authorization = view(head[http::field::authorization]);
  request_.accept_encoding = view(head[http::field::accept_encoding]);
  request_.if_none_match = view(head[http::field::if_none_match]);
  for (const auto once :
       {http::field::host, http::field::origin, http::field::authorization, http::field::content_length})
    request_.ambiguous = request_.ambiguous || head.count(once) > 1;
  // where two programs on the way differ about the length of a body, its end is somebody's next request
  request_.ambiguous = request_.ambiguous || head.count(http::field::transfer_encoding) > 0 ||
                       head[http::field::content_length].find(',') != beast::string_view::npos;
  request_.has_body = parser_->content_length().value_or(0) > 0;
  request_.upgrade = beast::websocket::is_upgrade(head);
  request_.subprotocol = http::token_list(head[http::field::sec_websocket_protocol]).exists("palpate.v1");
  request_.local_address = local_address_;
  request_.from = from_;
  request_.at = Clock::now();

  auto answer = hub_.site().answer(request_);
  const bool keep_alive = head.keep_alive() && !request_.has_body;
  if (std::holds_alternative<Upgrade>(answer)) return become_viewer();
  if (auto* ready = std::get_if<HttpAnswer>(&answer)) {
    if (ready->status >= 400) hub_.log().say(peer_, "refused, " + std::to_string(ready->status));
    return send(std::move(*ready), keep_alive && ready->status < 400);
  }

  // the volume or the picture may have to be made
  about_ = About::kMaking;
  get_on(kMadeWithin);
  if (auto* picture = std::get_if<PictureWanted>(&answer)) {
    hub_.want_picture(std::move(picture->key), weak_from_this(),
                      [self = weak_from_this(), picture_head = std::move(picture->head),
                       keep_alive](PictureStore::Payload payload) mutable {
                        const auto connection = self.lock();
                        if (!connection || connection->closed_) return;
                        if (!payload) return connection->refuse_volume("a picture");
                        picture_head.body = std::move(payload);
                        connection->send_volume(std::move(picture_head), keep_alive);
                      });
    return;
  }
  if (auto* curves = std::get_if<CurvesWanted>(&answer)) {
    hub_.want_curves(curves->learner, [self = weak_from_this(), curves_head = std::move(curves->head),
                                       keep_alive](Result<std::string> page) mutable {
      const auto connection = self.lock();
      if (!connection || connection->closed_) return;
      if (!page) return connection->send(Site::refusal(503, page.error().what), false);
      curves_head.body = std::make_shared<std::string>(*std::move(page));
      connection->send_volume(std::move(curves_head), keep_alive);
    });
    return;
  }
  auto& wanted = std::get<VolumeWanted>(answer);
  hub_.want_volume(wanted.key, [self = weak_from_this(), wanted_head = std::move(wanted.head),
                                keep_alive](PayloadStore::Payload payload) mutable {
    const auto connection = self.lock();
    if (!connection || connection->closed_) return;
    if (!payload) return connection->refuse_volume("a volume");
    wanted_head.body = std::move(payload);
    connection->send_volume(std::move(wanted_head), keep_alive);
  });
}

void Connection::refuse_volume(const std::string& what) {
  hub_.log().say(peer_, what + " could not be made");
  send(Site::refusal(503), false);
}

void Connection::become_viewer() {
  // nobody may speak the new protocol before it is agreed upon
  if (input_.size() > 0) return send(Site::refusal(400), false);
  hub_.make_room_for_silent_viewer();
  const auto viewer = std::make_shared<Viewer>(std::move(stream_), hub_);
  closed_ = true;
  hub_.remove(shared_from_this());
  hub_.add(viewer);
  viewer->begin(parser_->release());
}

void Connection::get_on(Clock::duration within) {
  since_ = Clock::now();
  close_by_ = since_ + within;
}

bool Connection::begin_answer(HttpAnswer answer, bool keep_alive) {
  answer_ = std::move(answer);
  head_ = hub_.site().head_of(answer_, request_, keep_alive);
  about_ = About::kTaking;
  taken_bytes_ = written_bytes_ = 0;
  get_on(kTakenWithin);
  return request_.method != "HEAD" && answer_.status != 304;
}

void Connection::send(HttpAnswer answer, bool keep_alive) {
  const std::string_view body = begin_answer(std::move(answer), keep_alive) ? answer_.text() : "";
  const std::array<net::const_buffer, 2> bytes{net::buffer(head_), net::buffer(body)};
  write(bytes, [this, keep_alive] { sent(keep_alive); });
}

void Connection::send_volume(HttpAnswer answer, bool keep_alive) {
  volume_left_ = begin_answer(std::move(answer), keep_alive) ? answer_.text() : "";
  write(std::array{net::buffer(head_)}, [this, keep_alive] { send_part(keep_alive); });
}

// one part after the other, each when it is its turn among those of all downloads
void Connection::send_part(bool keep_alive) {
  if (volume_left_.empty()) return sent(keep_alive);
  const auto turn = hub_.next_part(volume_left_.size());
  const auto send = [this, part = volume_left_.substr(0, turn.bytes), keep_alive] {
    volume_left_.remove_prefix(part.size());
    write(std::array{net::buffer(part)}, [this, keep_alive] { send_part(keep_alive); });
  };
  if (turn.at <= Clock::now()) return send();
  turn_.expires_at(turn.at);
  turn_.async_wait([self = shared_from_this(), send](ErrorCode failed) {
    if (!failed && !self->closed_) send();
  });
}

template <class Buffers, class Then>
void Connection::write(const Buffers& bytes, Then then) {
  // so much that is taken gives time for as much
  const auto progress = [self = shared_from_this()](ErrorCode failed, std::size_t taken) -> std::size_t {
    if (self->written_bytes_ + taken >= self->taken_bytes_ + kTaken_bytes) {
      self->taken_bytes_ = self->written_bytes_ + taken;
      self->get_on(kTakenWithin);
    }
    return failed ? 0 : kTaken_bytes;
  };
  net::async_write(*stream_, bytes, progress,
                   [self = shared_from_this(), then](ErrorCode failed, std::size_t taken) {
                     self->written_bytes_ += taken;
                     if (self->closed_) return;
                     if (failed) return self->close();
                     then();
                   });
}

void Connection::sent(bool keep_alive) {
  answer_ = {};
  if (!keep_alive) return linger();
  get_on(kNextHeadWithin);
  read();
}

// What the other side is still sending would make the system throw the answer away: it is read and dropped,
// for a moment.
void Connection::linger() {
  close_by_ = Clock::now() + kLingers;
  async_teardown(beast::role_type::server, *stream_,
                 [self = shared_from_this()](ErrorCode) { self->close(); });
}

void Connection::check(Clock::time_point now) {
  if (now < close_by_) return;
  // browsers open connections that they may never use, and keep those that they have used
  if (about_ == About::kSilent && parser_ && parser_->got_some()) hub_.log().say(peer_, "no request in time");
  if (about_ == About::kTaking && !answer_.text().empty())
    hub_.log().say(peer_, "takes its answer too slowly");
  close();
}

void Connection::close() {
  if (std::exchange(closed_, true)) return;
  turn_.cancel();
  stream_->close();
  hub_.remove(shared_from_this());
}

}  // namespace palpate::link
