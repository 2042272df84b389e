#include "server/connection.h"

#include <utility>

#include "server/hub.h"
#include "server/viewer.h"

namespace palpate::server {
namespace {

// time for the first request, including the TLS handshake; a later one may take longer
constexpr auto kFirstHeadWithin = std::chrono::seconds(5), kNextHeadWithin = std::chrono::seconds(15);
// minimum throughput: this many bytes, or the rest of the answer, per kWriteTimeout; slow readers would
// occupy connections
constexpr std::size_t kTaken_bytes = HttpConnection::kPart_bytes;
constexpr auto kWriteTimeout = std::chrono::seconds(10);
constexpr auto kGenerationTimeout = std::chrono::seconds(60);
constexpr auto kLingerTime = std::chrono::seconds(1);

}  // namespace

Connection::Connection(std::shared_ptr<HttpConnection> http, Hub& hub)
    : http_(std::move(http)),
      hub_(hub),
      turn_(hub.timer()),
      last_progress_(Clock::now()),
      close_by_(last_progress_ + kFirstHeadWithin) {}

void Connection::begin() {
  if (!http_->is_tls()) return read();
  http_->handshake([self = shared_from_this()](bool ok) {
    if (ok) return self->read();
    self->hub_.log().add(self->http_->peer(), "no TLS");
    self->close();
  });
}

void Connection::read() {
  if (closed_) return;
  phase_ = Phase::kAwaitingRequest;
  // its string views end with the next read
  request_ = {};
  http_->read_head([self = shared_from_this()](HttpConnection::Head outcome) {
    if (self->closed_) return;
    self->phase_ = Phase::kSending;
    if (outcome != HttpConnection::Head::kRead) return self->read_failed(outcome);
    self->serve();
  });
}

void Connection::read_failed(HttpConnection::Head outcome) {
  if (outcome == HttpConnection::Head::kClosed) return close();
  const bool too_long = outcome == HttpConnection::Head::kTooLong;
  hub_.log().add(http_->peer(), too_long ? "a request head that is too long" : "a malformed request");
  send(Site::refusal(too_long ? 431 : 400), false);
}

void Connection::serve() {
  request_ = http_->request();
  auto answer = hub_.site().answer(request_);
  const bool keep_alive = request_.keep_alive && !request_.has_body;
  if (std::holds_alternative<Upgrade>(answer)) return become_viewer();
  if (auto* ready = std::get_if<HttpResponse>(&answer)) {
    if (ready->status >= 400) hub_.log().add(http_->peer(), "refused, " + std::to_string(ready->status));
    return send(std::move(*ready), keep_alive && ready->status < 400);
  }

  // the volume or picture may have to be generated first
  phase_ = Phase::kGenerating;
  extend_deadline(kGenerationTimeout);
  if (auto* picture = std::get_if<PictureRequest>(&answer)) {
    hub_.request_picture(std::move(picture->key), weak_from_this(),
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
  if (auto* curves = std::get_if<CurvesRequest>(&answer)) {
    hub_.request_curves(curves->learner, [self = weak_from_this(), curves_head = std::move(curves->head),
                                          keep_alive](Result<std::string> page) mutable {
      const auto connection = self.lock();
      if (!connection || connection->closed_) return;
      if (!page) return connection->send(Site::refusal(503, page.error().what), false);
      curves_head.body = std::make_shared<std::string>(*std::move(page));
      connection->send_volume(std::move(curves_head), keep_alive);
    });
    return;
  }
  auto& requested = std::get<VolumeRequest>(answer);
  hub_.request_volume(requested.key, [self = weak_from_this(), requested_head = std::move(requested.head),
                                      keep_alive](PayloadStore::Payload payload) mutable {
    const auto connection = self.lock();
    if (!connection || connection->closed_) return;
    if (!payload) return connection->refuse_volume("a volume");
    requested_head.body = std::move(payload);
    connection->send_volume(std::move(requested_head), keep_alive);
  });
}

void Connection::refuse_volume(const std::string& what) {
  hub_.log().add(http_->peer(), what + " could not be created");
  send(Site::refusal(503), false);
}

void Connection::become_viewer() {
  // no bytes may follow the request before the upgrade is confirmed
  if (http_->has_more()) return send(Site::refusal(400), false);
  hub_.drop_oldest_unauthenticated();
  const auto viewer = std::make_shared<Viewer>(http_->upgrade(), http_->peer(), http_->from(), hub_);
  closed_ = true;
  hub_.remove(shared_from_this());
  hub_.add(viewer);
  viewer->begin();
}

void Connection::extend_deadline(Clock::duration within) {
  last_progress_ = Clock::now();
  close_by_ = last_progress_ + within;
}

bool Connection::begin_answer(HttpResponse answer, bool keep_alive) {
  answer_ = std::move(answer);
  head_ = hub_.site().head_of(answer_, request_, keep_alive);
  phase_ = Phase::kSending;
  consumed_bytes_ = written_bytes_ = 0;
  extend_deadline(kWriteTimeout);
  return request_.method != "HEAD" && answer_.status != 304;
}

void Connection::send(HttpResponse answer, bool keep_alive) {
  const std::string_view body = begin_answer(std::move(answer), keep_alive) ? answer_.text() : "";
  write(head_, body, [this, keep_alive] { sent(keep_alive); });
}

void Connection::send_volume(HttpResponse answer, bool keep_alive) {
  volume_left_ = begin_answer(std::move(answer), keep_alive) ? answer_.text() : "";
  write(head_, "", [this, keep_alive] { send_part(keep_alive); });
}

// sends one part after another, scheduled among all downloads
void Connection::send_part(bool keep_alive) {
  if (volume_left_.empty()) return sent(keep_alive);
  const auto turn = hub_.next_chunk(volume_left_.size());
  const auto send = [this, part = volume_left_.substr(0, turn.bytes), keep_alive] {
    volume_left_.remove_prefix(part.size());
    write(part, "", [this, keep_alive] { send_part(keep_alive); });
  };
  if (turn.not_before <= Clock::now()) return send();
  turn_->wait_until(turn.not_before, [self = shared_from_this(), send] {
    if (!self->closed_) send();
  });
}

void Connection::write(std::string_view head, std::string_view body, std::function<void()> then) {
  // every kTaken_bytes that the other side takes renews the time limit
  auto progress = [this](std::size_t used) {
    if (written_bytes_ + used < consumed_bytes_ + kTaken_bytes) return;
    consumed_bytes_ = written_bytes_ + used;
    extend_deadline(kWriteTimeout);
  };
  http_->write(head, body, std::move(progress),
               [self = shared_from_this(), then = std::move(then)](bool ok, std::size_t consumed) {
                 self->written_bytes_ += consumed;
                 if (self->closed_) return;
                 if (!ok) return self->close();
                 then();
               });
}

void Connection::sent(bool keep_alive) {
  answer_ = {};
  if (!keep_alive) return linger();
  extend_deadline(kNextHeadWithin);
  read();
}

// Reads and discards further input for a moment: unread input would make the system reset the connection and
// drop the answer.
void Connection::linger() {
  close_by_ = Clock::now() + kLingerTime;
  http_->linger([self = shared_from_this()] { self->close(); });
}

void Connection::check(Clock::time_point now) {
  if (now < close_by_) return;
  // browsers open connections that they may never use, and keep used ones open: not worth a log line
  if (phase_ == Phase::kAwaitingRequest && http_->has_started())
    hub_.log().add(http_->peer(), "no request in time");
  if (phase_ == Phase::kSending && !answer_.text().empty())
    hub_.log().add(http_->peer(), "receives its answer too slowly");
  close();
}

void Connection::close() {
  if (std::exchange(closed_, true)) return;
  turn_->cancel();
  http_->close();
  hub_.remove(shared_from_this());
}

}  // namespace palpate::server
