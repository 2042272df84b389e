// How old a pose is when a viewer has it: from the snapshot to the last byte of its WebSocket message, on
// loopback. See README.md.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <thread>
#include <vector>

#include "json_file.h"
#include "palpate/viewer_server.h"

namespace palpate::bench {
namespace {

struct Options {
  int viewers = 8;
  double poses_hz = 120, seconds = 20;
  bool stuck = false;
  std::string json;
};

// where the sequence and the server's clock stand in a pose, docs/viewer-protocol.md
constexpr std::size_t kSequenceAt = 8, kClockAt = 32, kPoseHead_bytes = 96;

std::int64_t now_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

/// A session that stands still: its snapshots cost a copy, as the loop's do.
class StillHost : public ViewerHost {
 public:
  StillHost() {
    GridGeometry grid;
    grid.dims = {8, 8, 8};
    scene_.labels = std::make_shared<Volume<LabelId>>(grid);
  }
  const ViewedScene& scene() const override { return scene_; }
  TickRecord snapshot(std::array<double, kMaxDevices>&) const override { return tick_; }
  ViewedHealth health() const override { return {}; }
  ViewedState state() const override { return {}; }
  Result<void> set(const SettingsRequest&) override { return {}; }
  Result<void> set(const TissueRequest&) override { return {}; }
  void emergency_stop() override {}
  Result<void> rearm() override { return {}; }
  Result<void> take_pointer(bool) override { return {}; }
  void move_pointer(const std::array<double, 3>&) override {}

 private:
  ViewedScene scene_;
  TickRecord tick_;
};

/// A viewer of plain sockets, which adds little of its own.
class Client {
 public:
  Client(int port, double poses_hz) {
    handle_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const int on = 1;
    ::setsockopt(handle_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(handle_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) return;
    say("GET /ws HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port) +
        "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: palpate.v1\r\n\r\n");
    while (input_.find("\r\n\r\n") == std::string::npos && receive()) {
    }
    input_.erase(0, std::min(input_.size(), input_.find("\r\n\r\n") + 4));
    const std::string hello =
        "{\"type\":\"hello\",\"protocol\":1,\"poses_hz\":" + std::to_string(poses_hz) + "}";
    // masked by zeros, which change nothing
    say(std::string("\x81") + static_cast<char>(0x80 | hello.size()) + std::string(4, '\0') + hello);
  }
  ~Client() { ::close(handle_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  /// Reads until the time is up.
  void run(std::int64_t until_ns) {
    while (now_ns() < until_ns) {
      const std::string pose = frame();
      const std::int64_t got_ns = now_ns();
      if (pose.empty()) return;
      if (pose.size() < kPoseHead_bytes || pose.compare(0, 4, "PLPT") != 0) continue;
      std::uint64_t sequence;
      std::int64_t clock_ns;
      std::memcpy(&sequence, pose.data() + kSequenceAt, sizeof sequence);
      std::memcpy(&clock_ns, pose.data() + kClockAt, sizeof clock_ns);
      if (last_ > 0) missed_ += sequence - last_ - 1;
      last_ = sequence;
      ages_ms_.push_back(static_cast<double>(got_ns - clock_ns) * 1e-6);
    }
  }
  const std::vector<double>& ages_ms() const { return ages_ms_; }
  std::uint64_t missed() const { return missed_; }

 private:
  void say(const std::string& bytes) { (void)!::send(handle_, bytes.data(), bytes.size(), MSG_NOSIGNAL); }
  bool receive() {
    char buffer[4096];
    const ssize_t got = ::recv(handle_, buffer, sizeof buffer, 0);
    if (got > 0) input_.append(buffer, static_cast<std::size_t>(got));
    return got > 0;
  }
  // the payload of the next message; empty at the end
  std::string frame() {
    while (true) {
      const auto byte = [&](std::size_t i) {
        return static_cast<std::size_t>(static_cast<unsigned char>(input_[i]));
      };
      const std::size_t head = input_.size() < 2 || byte(1) < 126 ? 2 : 4;
      if (input_.size() >= head) {
        const std::size_t length = head == 2 ? byte(1) : byte(2) << 8 | byte(3);
        if (input_.size() >= head + length) {
          const std::string payload = input_.substr(head, length);
          input_.erase(0, head + length);
          return payload;
        }
      }
      if (!receive()) return {};
    }
  }

  int handle_;
  std::string input_;
  std::vector<double> ages_ms_;
  std::uint64_t last_ = 0, missed_ = 0;
};

double quantile(const std::vector<double>& sorted, double q) {
  return sorted.empty() ? NAN : sorted[static_cast<std::size_t>(q * static_cast<double>(sorted.size() - 1))];
}

int run(const Options& options) {
  StillHost host;
  ViewerServerOptions server_options;
  server_options.port = 0;
  const auto server = ViewerServer::start(host, server_options);
  if (!server) {
    std::fprintf(stderr, "viewer_bench: %s\n", server.error().message().c_str());
    return 1;
  }
  std::vector<std::unique_ptr<Client>> clients;
  for (int n = 0; n < options.viewers; ++n)
    clients.push_back(std::make_unique<Client>((*server)->port(), options.poses_hz));
  // one that says hello and then reads nothing
  std::unique_ptr<Client> stuck;
  if (options.stuck) stuck = std::make_unique<Client>((*server)->port(), options.poses_hz);

  const std::int64_t until_ns = now_ns() + static_cast<std::int64_t>(options.seconds * 1e9);
  std::vector<std::thread> threads;
  for (const auto& client : clients) threads.emplace_back([&client, until_ns] { client->run(until_ns); });
  for (std::thread& thread : threads) thread.join();

  std::vector<double> ages_ms;
  std::uint64_t missed = 0;
  for (const auto& client : clients) {
    ages_ms.insert(ages_ms.end(), client->ages_ms().begin(), client->ages_ms().end());
    missed += client->missed();
  }
  std::sort(ages_ms.begin(), ages_ms.end());
  const double p50 = quantile(ages_ms, 0.5), p99 = quantile(ages_ms, 0.99), p999 = quantile(ages_ms, 0.999);
  const double most = quantile(ages_ms, 1);
  std::printf("%d viewers at %g Hz for %g s%s: %zu poses, %llu missed\n", options.viewers, options.poses_hz,
              options.seconds, options.stuck ? ", one more that reads nothing" : "", ages_ms.size(),
              static_cast<unsigned long long>(missed));
  std::printf("snapshot to receipt: median %.3f ms, p99 %.3f ms, p99.9 %.3f ms, largest %.3f ms\n", p50, p99,
              p999, most);
  return write_json("viewer_bench", options.json,
                    {{"viewers", options.viewers},
                     {"poses_hz", options.poses_hz},
                     {"seconds", options.seconds},
                     {"stuck", options.stuck},
                     {"poses", ages_ms.size()},
                     {"missed", missed},
                     {"p50_ms", p50},
                     {"p99_ms", p99},
                     {"p999_ms", p999},
                     {"max_ms", most}});
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  CLI::App app("From a snapshot to its receipt by viewers of WebSockets, on loopback");
  palpate::bench::Options options;
  app.add_option("--viewers", options.viewers, "how many watch")
      ->check(CLI::Range(1, 63))
      ->capture_default_str();
  app.add_option("--rate", options.poses_hz, "poses a second for each")
      ->check(CLI::Range(1.0, 120.0))
      ->capture_default_str();
  app.add_option("--seconds", options.seconds, "for how long")
      ->check(CLI::Range(0.1, 86400.0))
      ->capture_default_str();
  app.add_flag("--stuck", options.stuck, "and one more that reads nothing");
  app.add_option("--json", options.json, "write the figures to this file");
  CLI11_PARSE(app, argc, argv);
  return palpate::bench::run(options);
}
