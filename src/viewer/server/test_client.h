#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "base/test_wait.h"
#include "palpate/base/check.h"

/// Viewer client implemented from the RFCs alone, without code of the server, so that it can also send what
/// no library would.
namespace palpate::testing {

using Json = nlohmann::json;

/// Socket on which every wait has a time limit.
class TestSocket {
 public:
  static constexpr int kPatience_ms = static_cast<int>(std::chrono::milliseconds(kTestPatience).count());

  explicit TestSocket(int port, bool tls = false, int receive_buffer_bytes = 0) {
    handle_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    PALPATE_CHECK(handle_ >= 0);
    if (receive_buffer_bytes > 0)
      ::setsockopt(handle_, SOL_SOCKET, SO_RCVBUF, &receive_buffer_bytes, sizeof receive_buffer_bytes);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = ::connect(handle_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
    if (tls) begin_tls();
  }
  ~TestSocket() {
    if (tls_) SSL_free(tls_);
    if (context_) SSL_CTX_free(context_);
    ::close(handle_);
  }
  TestSocket(const TestSocket&) = delete;
  TestSocket& operator=(const TestSocket&) = delete;

  bool connected() const { return connected_; }
  /// False if the other side has closed.
  bool send(std::string_view bytes) {
    while (!bytes.empty()) {
      const long sent = tls_ ? SSL_write(tls_, bytes.data(), static_cast<int>(bytes.size()))
                             : ::send(handle_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (sent <= 0) return false;
      bytes.remove_prefix(static_cast<std::size_t>(sent));
    }
    return true;
  }
  /// Appends received bytes to the input; false at the end, or after `patience_ms` without any.
  bool receive(int patience_ms = kPatience_ms) {
    if (!tls_ || SSL_pending(tls_) == 0) {
      pollfd poll{handle_, POLLIN, 0};
      if (::poll(&poll, 1, patience_ms) <= 0) return false;
    }
    char buffer[65536];
    const long received =
        tls_ ? SSL_read(tls_, buffer, sizeof buffer) : ::recv(handle_, buffer, sizeof buffer, 0);
    if (received <= 0) {
      ended_ = true;
      return false;
    }
    input_.append(buffer, static_cast<std::size_t>(received));
    return true;
  }
  /// Exactly `bytes` bytes, or fewer if the other side closed.
  std::string take(std::size_t bytes) {
    while (input_.size() < bytes && receive()) {
    }
    const std::string used = input_.substr(0, bytes);
    input_.erase(0, used.size());
    return used;
  }
  /// Input up to and including `end`; all of it if `end` does not arrive.
  std::string take_until(std::string_view end) {
    std::size_t at;
    while ((at = input_.find(end)) == std::string::npos && receive()) {
    }
    return take(at == std::string::npos ? input_.size() : at + end.size());
  }
  /// Reads to the end; returns whether the other side closed.
  bool closes() {
    while (receive()) {
    }
    return ended_;
  }
  void end_sending() { ::shutdown(handle_, SHUT_WR); }

 private:
  void begin_tls() {
    context_ = SSL_CTX_new(TLS_client_method());
    tls_ = SSL_new(context_);
    SSL_set_fd(tls_, handle_);
    connected_ = connected_ && SSL_connect(tls_) == 1;
  }

  int handle_;
  SSL_CTX* context_ = nullptr;
  SSL* tls_ = nullptr;
  bool connected_ = false, ended_ = false;
  std::string input_;
};

struct TestAnswer {
  int status = 0;  ///< 0: no answer
  std::string head, body;

  std::string field(std::string_view name) const {
    const std::size_t at = head.find("\r\n" + std::string(name) + ": ");
    if (at == std::string::npos) return "";
    const std::size_t begin = at + name.size() + 4;
    return head.substr(begin, head.find("\r\n", begin) - begin);
  }
};

/// Reads one answer, framed as its head says.
inline TestAnswer read_answer(TestSocket& socket, bool bodiless = false) {
  TestAnswer answer;
  answer.head = socket.take_until("\r\n\r\n");
  if (answer.head.size() > 12) answer.status = std::atoi(answer.head.c_str() + 9);
  const std::string length = answer.field("Content-Length");
  if (!length.empty() && !bodiless) answer.body = socket.take(std::stoul(length));
  return answer;
}

/// Sends one request on a new connection. `fields` are lines "Name: value\r\n"; a Host is added if missing.
inline TestAnswer request(int port, const std::string& method, const std::string& target,
                          const std::string& fields = "", bool tls = false) {
  TestSocket socket(port, tls);
  const std::string host =
      fields.find("Host:") == std::string::npos ? "Host: 127.0.0.1:" + std::to_string(port) + "\r\n" : "";
  socket.send(method + " " + target + " HTTP/1.1\r\n" + host + fields + "\r\n");
  return read_answer(socket, method == "HEAD");
}

struct TestFrame {
  int opcode = -1;  ///< -1: the connection ended
  std::string payload;

  bool is_text() const { return opcode == 1; }
  bool is_binary() const { return opcode == 2; }
  /// Close code; 0 if it is not a close frame.
  int close_code() const {
    if (opcode != 8 || payload.size() < 2) return 0;
    return static_cast<unsigned char>(payload[0]) << 8 | static_cast<unsigned char>(payload[1]);
  }
};

/// Frame as sent by a client.
inline std::string masked_frame(int first_byte, std::string_view payload) {
  std::string frame(1, static_cast<char>(first_byte));
  if (payload.size() < 126) {
    frame += static_cast<char>(0x80 | payload.size());
  } else {
    PALPATE_CHECK(payload.size() < 65536);
    frame += static_cast<char>(0x80 | 126);
    frame += static_cast<char>(payload.size() >> 8);
    frame += static_cast<char>(payload.size() & 255);
  }
  constexpr char kMask[] = {0x11, 0x22, 0x33, 0x44};
  frame.append(kMask, 4);
  for (std::size_t i = 0; i < payload.size(); ++i) frame += static_cast<char>(payload[i] ^ kMask[i % 4]);
  return frame;
}

inline constexpr int kText = 0x81, kBinary = 0x82, kPing = 0x89, kClose = 0x88;

/// WebSocket client at /ws.
class TestViewer {
 public:
  explicit TestViewer(int port, const std::string& fields = "", bool tls = false,
                      int receive_buffer_bytes = 0)
      : socket_(port, tls, receive_buffer_bytes) {
    socket_.send("GET /ws HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port) +
                 "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                 "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: palpate.v1\r\n" +
                 fields + "\r\n");
    opening_ = read_answer(socket_);
  }
  const TestAnswer& opening() const { return opening_; }
  TestSocket& socket() { return socket_; }

  bool send(const Json& message) { return socket_.send(masked_frame(kText, message.dump())); }
  /// Says hello; returns the welcome.
  Json greet(const Json& more = Json::object()) {
    Json hello = {{"type", "hello"}, {"protocol", 3}};
    hello.update(more);
    send(hello);
    return text();
  }
  TestFrame frame() {
    TestFrame frame;
    const std::string head = socket_.take(2);
    if (head.size() < 2) return frame;
    std::size_t length = static_cast<unsigned char>(head[1]) & 127;
    const std::string longer = socket_.take(length == 126 ? 2 : length == 127 ? 8 : 0);
    if (!longer.empty()) length = 0;
    for (const char byte : longer) length = length << 8 | static_cast<unsigned char>(byte);
    frame.payload = socket_.take(length);
    if (frame.payload.size() == length) frame.opcode = head[0] & 15;
    return frame;
  }
  /// Next text message, skipping poses; null if the connection ends first.
  Json text() {
    TestFrame next = frame_but([](const TestFrame& frame) { return frame.is_binary(); });
    return next.is_text() ? Json::parse(next.payload) : Json();
  }
  /// Next text message of that type.
  Json text(const std::string& type) {
    Json next = text();
    while (!next.is_null() && next["type"] != type) next = text();
    return next;
  }
  /// Next pose, skipping texts; empty if the connection ends first.
  std::string pose() {
    const TestFrame next = frame_but([](const TestFrame& frame) { return frame.is_text(); });
    return next.is_binary() ? next.payload : "";
  }
  /// Close code of the server, skipping poses and texts; 0 if there is none.
  int close_code() {
    return frame_but([](const TestFrame& frame) { return frame.opcode != 8; }).close_code();
  }

 private:
  // next frame that is not skipped, until the time limit
  template <class Skip>
  TestFrame frame_but(Skip&& skip) {
    using Clock = std::chrono::steady_clock;
    const Clock::time_point until = Clock::now() + std::chrono::milliseconds(2 * TestSocket::kPatience_ms);
    TestFrame next = frame();
    while (next.opcode >= 0 && skip(next)) next = Clock::now() < until ? frame() : TestFrame();
    return next;
  }

  TestSocket socket_;
  TestAnswer opening_;
};

/// Little-endian integer at an offset of a message.
template <class T>
T number_at(std::string_view bytes, std::size_t offset) {
  T value{};
  PALPATE_CHECK(offset + sizeof value <= bytes.size());
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

}  // namespace palpate::testing
