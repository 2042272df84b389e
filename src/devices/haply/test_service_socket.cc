#include "haply/test_service_socket.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <openssl/evp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>

#include "palpate/base/check.h"

namespace palpate::testing {
namespace {

constexpr int kContinuation = 0, kCloseFrame = 8, kPingFrame = 9, kPongFrame = 10;
// longer than the driver's own timeouts, which therefore apply first
constexpr std::chrono::seconds kRequestPatience{10};

// RFC 6455, 4.2.2
std::string accept_key(const std::string& key) {
  const std::string text = key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11";
  std::array<unsigned char, 20> digest{};
  PALPATE_CHECK(EVP_Digest(text.data(), text.size(), digest.data(), nullptr, EVP_sha1(), nullptr) == 1);
  std::array<unsigned char, 29> encoded{};
  EVP_EncodeBlock(encoded.data(), digest.data(), static_cast<int>(digest.size()));
  return reinterpret_cast<const char*>(encoded.data());
}

// field of a request's header; empty if absent
std::string field(const std::string& head, const std::string& name) {
  const std::size_t at = head.find("\r\n" + name + ": ");
  if (at == std::string::npos) return "";
  const std::size_t begin = at + name.size() + 4;
  return head.substr(begin, head.find("\r\n", begin) - begin);
}

}  // namespace

std::string service_frame(std::string_view payload, int opcode, bool fin) {
  PALPATE_CHECK(payload.size() < 65536);
  std::string frame(1, static_cast<char>((fin ? 0x80 : 0) | opcode));
  if (payload.size() < 126) {
    frame += static_cast<char>(payload.size());
  } else {
    frame += '\x7e';
    frame += static_cast<char>(payload.size() >> 8);
    frame += static_cast<char>(payload.size() & 0xff);
  }
  frame += payload;
  return frame;
}

TestServiceSocket::TestServiceSocket(int handle) : handle_(handle) {
  const int on = 1;
  ::setsockopt(handle_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

TestServiceSocket::~TestServiceSocket() {
  close();
}

void TestServiceSocket::close() {
  lost_ = true;
  if (handle_ >= 0) ::close(handle_);
  handle_ = -1;
}

std::uint16_t TestServiceSocket::local_port() const {
  sockaddr_in address{};
  socklen_t size = sizeof address;
  PALPATE_CHECK(::getsockname(handle_, reinterpret_cast<sockaddr*>(&address), &size) == 0);
  return ntohs(address.sin_port);
}

bool TestServiceSocket::receive(std::chrono::milliseconds time) {
  pollfd requested{handle_, POLLIN, 0};
  if (lost_ || ::poll(&requested, 1, static_cast<int>(time.count())) != 1) return false;
  std::array<char, 65536> buffer;
  const ssize_t count = ::recv(handle_, buffer.data(), buffer.size(), 0);
  lost_ = count <= 0;
  if (!lost_) input_.append(buffer.data(), static_cast<std::size_t>(count));
  return !lost_;
}

bool TestServiceSocket::read_request() {
  constexpr std::string_view kEnd = "\r\n\r\n";
  while (input_.find(kEnd) == std::string::npos)
    if (!receive(kRequestPatience)) return false;
  const std::string head = input_.substr(0, input_.find(kEnd) + kEnd.size());
  input_.erase(0, head.size());
  const std::size_t begin = head.find(' ') + 1;
  target_ = head.substr(begin, head.find(' ', begin) - begin);
  key_ = field(head, "Upgrade") == "websocket" ? field(head, "Sec-WebSocket-Key") : "";
  return true;
}

void TestServiceSocket::answer(int status, const std::string& body) {
  write_raw("HTTP/1.1 " + std::to_string(status) +
            " Answer\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body);
}

bool TestServiceSocket::accept() {
  return write_raw(
      "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
      "Sec-WebSocket-Accept: " +
      accept_key(key_) + "\r\n\r\n");
}

bool TestServiceSocket::receive_frame(Frame& frame) {
  const auto byte = [&](std::size_t at) { return static_cast<unsigned char>(input_[at]); };
  if (input_.size() < 2) return false;
  std::size_t length = byte(1) & 0x7fu, at = 2;
  const std::size_t length_bytes = length == 126 ? 2 : length == 127 ? 8 : 0;
  // clients mask their frames
  PALPATE_CHECK((byte(1) & 0x80u) != 0);
  if (input_.size() < at + length_bytes) return false;
  if (length_bytes > 0) length = 0;
  for (const std::size_t end = at + length_bytes; at < end; ++at) length = length << 8 | byte(at);
  if (input_.size() < at + 4 + length) return false;
  frame.fin = (byte(0) & 0x80u) != 0;
  frame.opcode = byte(0) & 0x0f;
  frame.payload = input_.substr(at + 4, length);
  for (std::size_t n = 0; n < length; ++n)
    frame.payload[n] = static_cast<char>(frame.payload[n] ^ input_[at + n % 4]);
  input_.erase(0, at + 4 + length);
  return true;
}

TestServiceSocket::Read TestServiceSocket::read_for(std::chrono::milliseconds time, std::string& text) {
  const auto until = std::chrono::steady_clock::now() + time;
  for (;;) {
    Frame frame;
    while (receive_frame(frame)) {
      if (frame.opcode == kCloseFrame) {
        write_raw(service_frame(frame.payload, kCloseFrame));
        lost_ = true;
        return Read::kLost;
      }
      if (frame.opcode == kPingFrame) write_raw(service_frame(frame.payload, kPongFrame));
      if (frame.opcode == kPongFrame) pong_ = frame.payload;
      if (frame.opcode > kCloseFrame) continue;
      message_ = frame.opcode == kContinuation ? message_ + frame.payload : frame.payload;
      if (!frame.fin) continue;
      text = std::move(message_);
      message_.clear();
      return Read::kMessage;
    }
    const auto left = until - std::chrono::steady_clock::now();
    if (!receive(std::chrono::ceil<std::chrono::milliseconds>(std::max(left, left.zero()))))
      return lost_ ? Read::kLost : Read::kNothing;
  }
}

bool TestServiceSocket::write(std::string_view text) {
  return write_raw(service_frame(text));
}

bool TestServiceSocket::write_raw(std::string_view bytes) {
  while (!lost_ && !bytes.empty()) {
    const ssize_t sent = ::send(handle_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    lost_ = sent <= 0;
    if (!lost_) bytes.remove_prefix(static_cast<std::size_t>(sent));
  }
  return !lost_;
}

}  // namespace palpate::testing
