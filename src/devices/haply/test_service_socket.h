#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

namespace palpate::testing {

/// The service's end of a connection: an HTTP request, followed by a response or a WebSocket. Implemented
/// from RFC 6455, independently of the driver. Blocking, single-threaded.
class TestServiceSocket {
 public:
  /// Takes ownership of an accepted socket.
  explicit TestServiceSocket(int handle);
  ~TestServiceSocket();
  TestServiceSocket(const TestServiceSocket&) = delete;
  TestServiceSocket& operator=(const TestServiceSocket&) = delete;

  std::uint16_t local_port() const;
  /// Waits for a request. Returns false if the client closed before sending one.
  bool read_request();
  const std::string& target() const { return target_; }
  bool is_upgrade() const { return !key_.empty(); }
  void answer(int status, const std::string& body);
  /// Accepts the upgrade. Returns false if the connection is lost.
  bool accept();

  enum class Read { kMessage, kNothing, kLost };
  /// Next text message, or kNothing if none is complete within that time. Answers pings.
  Read read_for(std::chrono::milliseconds time, std::string& text);
  /// Payload of the latest pong.
  const std::string& pong() const { return pong_; }
  /// Sends one text message. Returns false if the connection is lost.
  bool write(std::string_view text);
  /// Sends raw bytes. Returns false if the connection is lost.
  bool write_raw(std::string_view bytes);
  /// Closes without a close frame.
  void close();

 private:
  struct Frame {
    bool fin = false;
    int opcode = 0;
    std::string payload;
  };
  /// Returns false if nothing arrived within that time, or if the connection is lost.
  bool receive(std::chrono::milliseconds time);
  /// Extracts a complete frame from the input. Returns false if there is none.
  bool receive_frame(Frame& frame);

  int handle_;
  bool lost_ = false;
  std::string input_, message_, target_, key_, pong_;
};

/// A server's frame (RFC 6455, 5.2).
/// @param fin  false: more fragments of the message follow
std::string service_frame(std::string_view payload, int opcode = 1, bool fin = true);

}  // namespace palpate::testing
