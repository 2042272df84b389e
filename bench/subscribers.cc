#include "subscribers.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstring>
#include <utility>

#include "fast_dds_node.h"
#include "viewer_client.h"

namespace palpate::bench {
namespace {

// header of a message: the offsets of its fields, and its size
constexpr std::size_t kTypeAt = 2, kNameAt = 14, kStampAt = 34, kBodySizeAt = 42, kHead_bytes = 58;

double system_s() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

std::uint64_t big_endian(const unsigned char* bytes) {
  std::uint64_t value = 0;
  for (int n = 0; n < 8; ++n) value = value << 8 | bytes[n];
  return value;
}

}  // namespace

void Received::add(const Received& other) {
  messages += other.messages;
  ages_ms.insert(ages_ms.end(), other.ages_ms.begin(), other.ages_ms.end());
}

Received receive_openigtlink_until(int port, std::int64_t until_ns) {
  Received received;
  const int handle = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  // no read blocks for longer than the measurement
  const timeval patience{0, 200'000};
  ::setsockopt(handle, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::vector<unsigned char> input;
  std::array<unsigned char, 65536> buffer;
  bool connected = ::connect(handle, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  while (connected && steady_ns() < until_ns) {
    const ssize_t count = ::recv(handle, buffer.data(), buffer.size(), 0);
    connected = count != 0;
    if (count <= 0) continue;
    input.insert(input.end(), buffer.begin(), buffer.begin() + count);
    std::size_t at = 0;
    while (input.size() - at >= kHead_bytes) {
      const unsigned char* const head = input.data() + at;
      const std::size_t size = kHead_bytes + big_endian(head + kBodySizeAt);
      if (input.size() - at < size) break;
      if (std::memcmp(head + kTypeAt, "TRANSFORM", 10) == 0 &&
          std::memcmp(head + kNameAt, "ProbeToRAS", 11) == 0) {
        ++received.messages;
        const double stamp_s = static_cast<double>(big_endian(head + kStampAt)) / 4294967296.0;
        received.ages_ms.push_back(1e3 * (system_s() - stamp_s));
      }
      at += size;
    }
    input.erase(input.begin(), input.begin() + static_cast<std::ptrdiff_t>(at));
  }
  ::close(handle);
  return received;
}

Received receive_ros2_until(int domain, std::int64_t until_ns) {
  Received received;
  fast_dds::Node node(domain);
  auto* const poses = node.subscribe("rt/palpate/hand1/measured_cp",
                                     fast_dds::message_type("geometry_msgs", "PoseStamped"), false);
  auto* const forces = node.subscribe("rt/palpate/hand1/measured_cf",
                                      fast_dds::message_type("geometry_msgs", "WrenchStamped"), false);
  for (std::int64_t now_ns = 0; (now_ns = steady_ns()) < until_ns;) {
    if (auto pose = fast_dds::Node::next(poses, std::chrono::nanoseconds(until_ns - now_ns))) {
      ++received.messages;
      const auto stamp_ns = static_cast<double>(fast_dds::Cdr(*std::move(pose)).time_ns());
      received.ages_ms.push_back(1e3 * (system_s() - 1e-9 * stamp_ns));
    }
    // a force is sent just after the pose of its tick
    while (fast_dds::Node::next(forces, std::chrono::nanoseconds(0))) ++received.messages;
  }
  return received;
}

}  // namespace palpate::bench
