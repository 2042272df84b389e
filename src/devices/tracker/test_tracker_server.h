#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "openigtlink/test_messages.h"
#include "palpate/base/check.h"

namespace palpate::test {

/// Local tracker server: sends the poses of its tools to any client 200 times per second, unless configured
/// otherwise.
class TrackerServer {
 public:
  struct Tool {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    bool seen = true;
  };

  TrackerServer() : listening_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = ::htonl(INADDR_LOOPBACK);
    PALPATE_CHECK(::bind(listening_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0);
    socklen_t size = sizeof address;
    PALPATE_CHECK(::getsockname(listening_, reinterpret_cast<sockaddr*>(&address), &size) == 0);
    port_ = ::ntohs(address.sin_port);
    PALPATE_CHECK(::listen(listening_, 4) == 0);
    thread_ = std::thread([this] { serve(); });
  }
  ~TrackerServer() {
    end_ = true;
    thread_.join();
    ::close(listening_);
  }
  int port() const { return port_; }

  void move(const std::string& name, const Tool& tool) {
    const std::lock_guard lock(mutex_);
    tools_[name] = tool;
  }
  /// Replaces the messages of all tools; empty: sends the tools again.
  void send_instead(const std::optional<MessageBytes>& bytes) {
    const std::lock_guard lock(mutex_);
    instead_ = bytes;
  }
  /// Drops the current connection without a shutdown.
  void drop() { drops_ = true; }
  /// Input received from the last client.
  MessageBytes heard() const {
    const std::lock_guard lock(mutex_);
    return received_;
  }
  int connections() const { return connections_; }

 private:
  void serve() {
    int client = -1;
    for (std::uint64_t frame = 1; !end_; ++frame) {
      pollfd waiting{listening_, POLLIN, 0};
      if (client < 0 && ::poll(&waiting, 1, 5) > 0) {
        client = ::accept4(listening_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
        const std::lock_guard lock(mutex_);
        received_.clear();
        ++connections_;
      }
      if (drops_.exchange(false) && client >= 0) {
        // with a reset, as if the machine had died
        const linger at_once{1, 0};
        ::setsockopt(client, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
        ::close(client);
        client = -1;
      }
      if (client >= 0 && !send_frame(client, frame)) {
        ::close(client);
        client = -1;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    if (client >= 0) ::close(client);
  }
  bool send_frame(int client, std::uint64_t frame) {
    const std::lock_guard lock(mutex_);
    std::uint8_t buffer[256];
    for (ssize_t received; (received = ::recv(client, buffer, sizeof buffer, 0)) > 0;)
      received_.insert(received_.end(), buffer, buffer + received);
    MessageBytes all;
    // one frame every hundredth of a second
    for (const auto& [name, tool] : tools_) {
      const MessageWords words{{"TransformStatus", tool.seen ? "OK" : "OUT_OF_VIEW"}};
      const auto one = message_bytes("TRANSFORM", name, matrix_bytes(tool.pose), &words, frame << 26);
      all.insert(all.end(), one.begin(), one.end());
    }
    if (instead_) all = *instead_;
    return all.empty() ||
           ::send(client, all.data(), all.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(all.size());
  }

  const int listening_;
  int port_ = 0;
  std::atomic<bool> end_{false}, drops_{false};
  std::atomic<int> connections_{0};
  mutable std::mutex mutex_;
  std::map<std::string, Tool> tools_;
  std::optional<MessageBytes> instead_;
  MessageBytes received_;
  std::thread thread_;
};

}  // namespace palpate::test
