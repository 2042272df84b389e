#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "server/site.h"
#include "server/transport.h"

namespace palpate::server {

class Hub;

/// HTTP connection: request, answer, repeat. A WebSocket upgrade hands it over to a Viewer.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  using Clock = std::chrono::steady_clock;

  Connection(std::shared_ptr<HttpConnection> http, Hub& hub);

  void begin();
  /// Closes the connection if it exceeds its time limit.
  void check(Clock::time_point now);
  void close();

  /// Current activity, in the order in which connections are dropped when there are too many.
  enum class Phase : std::uint8_t {
    kAwaitingRequest,  ///< Waiting for a request
    kSending,          ///< Sending an answer
    kGenerating,       ///< Waiting for an answer to be generated
  };
  Phase phase() const { return phase_; }
  /// Time of the last progress.
  Clock::time_point last_progress() const { return last_progress_; }
  /// Address of the other side.
  const std::string& peer() const { return http_->peer(); }
  /// Whether a volume is being sent.
  bool is_loading() const { return !volume_left_.empty(); }

 private:
  void read();
  void read_failed(HttpConnection::Head outcome);
  void serve();
  void refuse_volume(const std::string& what);
  void become_viewer();
  /// Returns whether a body follows.
  bool begin_answer(HttpResponse answer, bool keep_alive);
  void send(HttpResponse answer, bool keep_alive);
  void send_volume(HttpResponse answer, bool keep_alive);
  void send_part(bool keep_alive);
  /// Writes, and extends the time limit with every 64 KiB that the system has taken.
  void write(std::string_view head, std::string_view body, std::function<void()> then);
  void sent(bool keep_alive);
  void linger();
  void extend_deadline(Clock::duration within);

  std::shared_ptr<HttpConnection> http_;
  Hub& hub_;
  HttpRequest request_;
  HttpResponse answer_;
  std::string head_;
  Phase phase_ = Phase::kAwaitingRequest;
  bool closed_ = false;
  std::size_t consumed_bytes_ = 0, written_bytes_ = 0;  // bytes of the answer
  std::string_view volume_left_;
  std::unique_ptr<Timer> turn_;
  Clock::time_point last_progress_, close_by_;
};

}  // namespace palpate::server
