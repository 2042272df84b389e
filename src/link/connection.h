#pragma once

#include <boost/asio/basic_waitable_timer.hpp>
#include <boost/beast/core/flat_static_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "link/site.h"
#include "link/stream.h"

namespace palpate::link {

class Hub;

/// One connection as long as it speaks HTTP: request, answer, and again. A WebSocket becomes a Viewer.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  using Clock = std::chrono::steady_clock;
  /// No request's head is longer.
  static constexpr std::size_t kMostHead_bytes = 8192;

  Connection(std::unique_ptr<Stream> stream, Hub& hub);

  void begin();
  /// Closes what takes too long.
  void check(Clock::time_point now);
  void close();

  /// What it is about, in the order in which connections give way where there are too many.
  enum class About : std::uint8_t {
    kSilent,  ///< has yet to say what it wants
    kTaking,  ///< takes its answer
    kMaking,  ///< its answer is being made
  };
  About about() const { return about_; }
  /// When it last got on.
  Clock::time_point since() const { return since_; }
  /// Whether a volume is on its way.
  bool is_loading() const { return !volume_left_.empty(); }

 private:
  using Parser = beast::http::request_parser<beast::http::empty_body>;

  void read();
  void read_failed(ErrorCode failed);
  void serve();
  void refuse_volume(const std::string& what);
  void become_viewer();
  /// Whether a body follows.
  bool begin_answer(HttpAnswer answer, bool keep_alive);
  void send(HttpAnswer answer, bool keep_alive);
  void send_volume(HttpAnswer answer, bool keep_alive);
  void send_part(bool keep_alive);
  /// Writes, and says that it got on with each 64 KiB that were taken.
  template <class Buffers, class Then>
  void write(const Buffers& bytes, Then then);
  void sent(bool keep_alive);
  void linger();
  void get_on(Clock::duration within);

  std::unique_ptr<Stream> stream_;
  Hub& hub_;
  const std::string peer_;
  const AddressBlock from_;
  std::string local_address_;
  beast::flat_static_buffer<2 * kMostHead_bytes> input_;
  std::optional<Parser> parser_;
  HttpRequest request_;
  HttpAnswer answer_;
  std::string head_;
  About about_ = About::kSilent;
  bool closed_ = false;
  std::size_t taken_bytes_ = 0, written_bytes_ = 0;  // of the answer
  std::string_view volume_left_;
  net::basic_waitable_timer<Clock, net::wait_traits<Clock>, Stream::executor_type> turn_;
  Clock::time_point since_, close_by_;
};

}  // namespace palpate::link
