#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

namespace palpate::testing {

/// The service's end of one connection: an HTTP request, then an answer or a WebSocket. Written from RFC 6455
/// alone and shares no code with the driver. Blocking, of one thread.
class TestServiceSocket {
 public:
  /// Takes over an accepted socket.
  explicit TestServiceSocket(int handle);
  ~TestServiceSocket();
  TestServiceSocket(const TestServiceSocket&) = delete;
  TestServiceSocket& operator=(const TestServiceSocket&) = delete;

  std::uint16_t local_port() const;
  /// Waits for a request. False: none came before the client closed.
  bool read_request();
  const std::string& target() const { return target_; }
  bool is_upgrade() const { return !key_.empty(); }
  void answer(int status, const std::string& body);
  /// Agrees to the upgrade. False: lost.
  bool accept();

  enum class Read { kMessage, kNothing, kLost };
  /// The next text, or nothing where none has come whole within that time. Answers pings.
  Read read_for(std::chrono::milliseconds time, std::string& text);
  /// Payload of the latest pong.
  const std::string& pong() const { return pong_; }
  /// As one text. False: lost.
  bool write(std::string_view text);
  /// Bytes as they stand. False: lost.
  bool write_raw(std::string_view bytes);
  /// Without a close frame.
  void close();

 private:
  struct Frame {
    bool fin = false;
    int opcode = 0;
    std::string payload;
  };
  /// False: nothing came within that time, or the connection is lost.
  bool receive(std::chrono::milliseconds time);
  /// Takes a whole frame off the input. False: there is none yet.
  bool take_frame(Frame& frame);

  int handle_;
  bool lost_ = false;
  std::string input_, message_, target_, key_, pong_;
};

/// A frame as a server sends it (RFC 6455, 5.2).
/// @param fin  false: another part of the message follows
std::string service_frame(std::string_view payload, int opcode = 1, bool fin = true);

}  // namespace palpate::testing
