#include "viewer_client.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace palpate::bench {
namespace {

// offsets of the sequence number and the server's clock in a pose, docs/reference/viewer-messages.md
constexpr std::size_t kSequenceAt = 8, kClockAt = 32, kPoseHead_bytes = 96;
// offsets in a bundle of ticks
constexpr std::size_t kCountAt = 12, kLostAt = 24, kBundleHead_bytes = 32;

}  // namespace

std::int64_t steady_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

void ReceivedPoses::add(const ReceivedPoses& other) {
  ages_ms.insert(ages_ms.end(), other.ages_ms.begin(), other.ages_ms.end());
  missed += other.missed;
  ticks += other.ticks;
  lost_ticks += other.lost_ticks;
}

ViewerClient::ViewerClient(int port, double poses_hz, int receive_buffer_bytes, Requested requested) {
  handle_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  ::setsockopt(handle_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  if (receive_buffer_bytes > 0)
    ::setsockopt(handle_, SOL_SOCKET, SO_RCVBUF, &receive_buffer_bytes, sizeof receive_buffer_bytes);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (::connect(handle_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) return;
  send("GET /ws HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port) +
       "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
       "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: palpate.v1\r\n\r\n");
  while (input_.find("\r\n\r\n") == std::string::npos && receive()) {
  }
  input_.erase(0, std::min(input_.size(), input_.find("\r\n\r\n") + 4));
  const char* const more = requested == Requested::kTask    ? ",\"task\":true"
                           : requested == Requested::kTicks ? ",\"ticks\":true"
                                                            : "";
  const std::string hello =
      "{\"type\":\"hello\",\"protocol\":3,\"poses_hz\":" + std::to_string(poses_hz) + more + "}";
  // masked with zeros, which leaves the payload unchanged
  send(std::string("\x81") + static_cast<char>(0x80 | hello.size()) + std::string(4, '\0') + hello);
}

ViewerClient::~ViewerClient() {
  ::close(handle_);
}

void ViewerClient::read_until(std::int64_t until_ns) {
  while (steady_ns() < until_ns) {
    const std::string pose = frame();
    const std::int64_t got_ns = steady_ns();
    if (pose.empty()) return;
    if (pose.size() >= kBundleHead_bytes && pose.compare(0, 4, "PLPB") == 0) {
      std::uint32_t count;
      std::memcpy(&count, pose.data() + kCountAt, sizeof count);
      std::memcpy(&received_.lost_ticks, pose.data() + kLostAt, sizeof received_.lost_ticks);
      received_.ticks += count;
    }
    if (pose.size() < kPoseHead_bytes || pose.compare(0, 4, "PLPT") != 0) continue;
    std::uint64_t sequence;
    std::int64_t clock_ns;
    std::memcpy(&sequence, pose.data() + kSequenceAt, sizeof sequence);
    std::memcpy(&clock_ns, pose.data() + kClockAt, sizeof clock_ns);
    if (last_ > 0) received_.missed += sequence - last_ - 1;
    last_ = sequence;
    received_.ages_ms.push_back(static_cast<double>(got_ns - clock_ns) * 1e-6);
  }
}

void ViewerClient::send(const std::string& bytes) {
  (void)!::send(handle_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
}

bool ViewerClient::receive() {
  char buffer[32768];
  const ssize_t received = ::recv(handle_, buffer, sizeof buffer, 0);
  if (received > 0) input_.append(buffer, static_cast<std::size_t>(received));
  return received > 0;
}

// payload of the next message; empty if the connection has ended
std::string ViewerClient::frame() {
  while (true) {
    const auto byte = [&](std::size_t i) {
      return static_cast<std::size_t>(static_cast<unsigned char>(input_[i]));
    };
    const std::size_t head = input_.size() < 2 || byte(1) < 126 ? 2 : byte(1) == 126 ? 4 : 10;
    if (input_.size() >= head) {
      std::size_t length = head == 2 ? byte(1) : 0;
      for (std::size_t n = 2; n < head; ++n) length = length << 8 | byte(n);
      if (input_.size() >= head + length) {
        const std::string payload = input_.substr(head, length);
        input_.erase(0, head + length);
        return payload;
      }
    }
    if (!receive()) return {};
  }
}

namespace {

/// Requests on a persistent connection; the body is counted or stored.
class Download {
 public:
  explicit Download(int port) : port_(port), handle_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    // no read blocks for longer than the measurement
    const timeval patience{0, 200'000};
    ::setsockopt(handle_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = ::connect(handle_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  ~Download() { ::close(handle_); }
  Download(const Download&) = delete;
  Download& operator=(const Download&) = delete;

  /// Returns whether the response was completed in time.
  bool get(const std::string& target, std::int64_t until_ns, std::uint64_t& bytes,
           std::string* body = nullptr) {
    const std::string request = "GET " + target + " HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port_) +
                                "\r\nAccept-Encoding: gzip\r\n\r\n";
    if (!connected_ || ::send(handle_, request.data(), request.size(), MSG_NOSIGNAL) < 0) return false;
    std::string head;
    std::size_t end = std::string::npos;
    while ((end = head.find("\r\n\r\n")) == std::string::npos) {
      if (steady_ns() >= until_ns) return false;
      const ssize_t received = ::recv(handle_, buffer_.data(), buffer_.size(), 0);
      if (received == 0) return false;
      if (received > 0) head.append(buffer_.data(), static_cast<std::size_t>(received));
    }
    const std::size_t declared = head.find("\r\nContent-Length: ");
    if (declared == std::string::npos) return false;
    const std::size_t length = std::stoul(head.substr(declared + 18));
    std::size_t got_bytes = head.size() - end - 4;
    bytes += got_bytes;
    if (body) *body = head.substr(end + 4);
    while (got_bytes < length) {
      if (steady_ns() >= until_ns) return false;
      const ssize_t count = ::recv(handle_, buffer_.data(), std::min(buffer_.size(), length - got_bytes), 0);
      if (count == 0) return false;
      if (count < 0) continue;
      got_bytes += static_cast<std::size_t>(count);
      bytes += static_cast<std::uint64_t>(count);
      if (body) body->append(buffer_.data(), static_cast<std::size_t>(count));
    }
    return true;
  }

 private:
  int port_, handle_;
  bool connected_ = false;
  std::vector<char> buffer_ = std::vector<char>(256 << 10);
};

}  // namespace

Downloads download_until(int port, std::int64_t until_ns) {
  Downloads observed;
  Download connection(port);
  const std::int64_t begin_ns = steady_ns();
  std::uint64_t other_bytes = 0;
  std::string scene;
  if (!connection.get("/api/scene", until_ns, other_bytes, &scene)) return observed;
  const std::size_t at = scene.find("\"hash\":");
  const std::size_t quote = scene.find('"', at + 7);
  if (at == std::string::npos || quote == std::string::npos) return observed;
  const std::string hash = scene.substr(quote + 1, scene.find('"', quote + 1) - quote - 1);
  for (std::uint64_t n = 0; steady_ns() < until_ns; ++n) {
    const char* const kind = n % 2 == 0 ? "scan/" : "labels/";
    if (!connection.get("/api/volume/" + std::string(kind) + hash, until_ns, observed.bytes)) return observed;
    ++observed.whole;
    if (n == 1) observed.first_ms = static_cast<double>(steady_ns() - begin_ns) * 1e-6;
  }
  return observed;
}

double quantile(std::vector<double>& values, double part) {
  if (values.empty()) return NAN;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

}  // namespace palpate::bench
