#include "palpate/openigtlink_server/openigtlink_server.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <deque>
#include <exception>
#include <future>
#include <list>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "openigtlink_server/published_session.h"
#include "palpate/base/printable.h"
#include "palpate/openigtlink/requests.h"
#include "palpate/server/address.h"
#include "palpate/server/fresh_socket.h"
#include "palpate/server/ordinary_thread.h"

namespace palpate {
namespace {

using openigtlink_server::Message;
using openigtlink_server::PublishedSession;
using openigtlink_server::Structures;
using Clock = std::chrono::steady_clock;

constexpr auto kSlicePeriod = std::chrono::milliseconds(200);
/// Minimum time between the encoding of all labels, or of a box of them, and the next.
constexpr auto kLabelsPeriod = std::chrono::milliseconds(50), kBoxPeriod = std::chrono::milliseconds(10);
constexpr auto kStatePeriod = std::chrono::milliseconds(50);
constexpr auto kAcceptPause = std::chrono::milliseconds(500);
/// A client that reads nothing for this long is disconnected.
constexpr auto kPatience = std::chrono::seconds(10);
constexpr std::size_t kMaxQueued = 8;  // messages, not counting frames
constexpr int kBacklog = 8, kSendBuffer_bytes = 1 << 18;
constexpr std::array<double, 2> kRates_hz{1, 1000};

class FileDescriptor {
 public:
  FileDescriptor() = default;
  explicit FileDescriptor(int number) : number_(number) {}
  FileDescriptor(FileDescriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~FileDescriptor() {
    if (number_ >= 0) ::close(number_);
  }
  int get() const { return number_; }

 private:
  int number_ = -1;
};

struct Client {
  FileDescriptor socket;
  std::string peer;
  igtl::RequestReader input;
  std::deque<Message> queue;  ///< Messages to be sent, before the next frame
  std::size_t sent = 0;       ///< Bytes of the first one that the system has taken
  Clock::time_point progress = Clock::now();
  Structures structures;  ///< As last sent
  std::optional<int> slice;
  Clock::time_point next_slice{};
  bool is_stopped = false, is_greeted = false;
  bool wants_labels = false;     ///< A GET_IMAGE or STT_IMAGE has not been answered: all labels are due
  bool follows_labels = false;   ///< From STT_IMAGE to STP_IMAGE: receives the labels after each change
  bool awaits_encoding = false;  ///< The message that is being encoded is for it
  std::shared_ptr<const Bricks<LabelId>> labels;  ///< Version that it has, or that is being encoded for it
  std::string fault;                              ///< Reason to drop it; empty: none
};

/// Frame of a tick, for every client that was last sent the same structures.
struct EncodedFrame {
  Structures before, after;
  Message message;
};

class Server final : public OpenIgtLinkServer {
 public:
  Server(const ViewerHost& host, const OpenIgtLinkOptions& options, FileDescriptor listening,
         FileDescriptor wake, int port)
      : host_(host),
        session_(host),
        options_(options),
        listening_(std::move(listening)),
        wake_(std::move(wake)),
        port_(port),
        period_(
            std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / options.rate_hz))),
        thread_([this] { run(); }) {}
  ~Server() override {
    ended_ = true;
    const std::uint64_t one = 1;
    // an eventfd takes 8 bytes as long as its counter is not full
    (void)!::write(wake_.get(), &one, sizeof one);
    thread_.join();
  }
  int port() const override { return port_; }
  int clients() const override { return clients_count_; }

 private:
  void run() {
    server::use_ordinary_priority("openigtlink");
    auto next = Clock::now();
    while (!ended_) {
      // without memory or threads the clients are disconnected, and the session continues
      try {
        wait_until(next);
        if (ended_) return;
        const auto now = Clock::now();
        if (now >= next) {
          publish(now);
          next = std::max(next + period_, now);
        }
        for (Client& client : clients_)
          if (Clock::now() - client.progress > kPatience && !client.queue.empty())
            client.fault = "takes no messages";
        drop_faulty();
      } catch (const std::exception&) {
        clients_.clear();
        clients_count_ = 0;
      }
    }
  }

  void wait_until(Clock::time_point next) {
    std::vector<pollfd> waiting{{wake_.get(), POLLIN, 0}, {listening_.get(), 0, 0}};
    if (Clock::now() >= next_accept_) waiting[1].events = POLLIN;
    for (const Client& client : clients_)
      waiting.push_back(
          {client.socket.get(), static_cast<short>(POLLIN | (client.queue.empty() ? 0 : POLLOUT)), 0});
    const auto left = std::chrono::ceil<std::chrono::nanoseconds>(std::max(next - Clock::now(), {}));
    const timespec timeout{static_cast<time_t>(left.count() / 1'000'000'000),
                           static_cast<long>(left.count() % 1'000'000'000)};
    if (::ppoll(waiting.data(), waiting.size(), &timeout, nullptr) <= 0) return;
    std::size_t n = 2;
    for (Client& client : clients_) {
      const short events = waiting[n++].revents;
      if ((events & (POLLIN | POLLHUP | POLLERR)) != 0) receive(client);
      if ((events & POLLOUT) != 0) send(client);
    }
    if (waiting[1].revents != 0) accept();
  }

  void accept() {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    FileDescriptor socket(::accept4(listening_.get(), reinterpret_cast<sockaddr*>(&address), &size,
                                    SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (socket.get() < 0) {
      // without a free descriptor the connection remains pending, and would be reported continuously
      if (errno != EAGAIN && errno != EINTR) next_accept_ = Clock::now() + kAcceptPause;
      return;
    }
    std::string peer = peer_text(address);
    if (static_cast<int>(clients_.size()) >= kMaxClients) {
      log(peer + " is refused: " + std::to_string(kMaxClients) + " clients are connected");
      return;
    }
    server::set_low_latency_options(socket.get(), kSendBuffer_bytes);
    Client& client = clients_.emplace_back();
    client.socket = std::move(socket);
    client.peer = std::move(peer);
    clients_count_ = static_cast<int>(clients_.size());
  }
  static std::string peer_text(const sockaddr_storage& address) {
    char text[INET6_ADDRSTRLEN] = "?";
    if (address.ss_family == AF_INET)
      ::inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in&>(address).sin_addr, text, sizeof text);
    else if (address.ss_family == AF_INET6)
      ::inet_ntop(AF_INET6, &reinterpret_cast<const sockaddr_in6&>(address).sin6_addr, text, sizeof text);
    return std::string("OpenIGTLink client ") + text;
  }

  void receive(Client& client) {
    std::array<std::uint8_t, 4096> buffer;
    const ssize_t received = ::recv(client.socket.get(), buffer.data(), buffer.size(), 0);
    if (received < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (received <= 0) {
      client.fault = kLeft;
      return;
    }
    const auto used = client.input.consume(
        std::span(buffer).first(static_cast<std::size_t>(received)),
        [&](igtl::Request request, const std::string& name) { answer(client, request, name); });
    if (!used) client.fault = "does not send OpenIGTLink messages";
  }
  void answer(Client& client, igtl::Request request, const std::string& name) {
    // without a name a client asks for any image
    const bool is_labels = name.empty() || name == openigtlink_server::kLabelsName;
    switch (request) {
      case igtl::Request::kLabelList:
        return queue(client, session_.label_list());
      case igtl::Request::kImageList:
        return queue(client, session_.image_list());
      case igtl::Request::kImage:
        client.wants_labels = client.wants_labels || is_labels;
        if (name == openigtlink_server::kSliceName) client.slice.reset();
        return;
      case igtl::Request::kStartImages:
        if (is_labels) client.wants_labels = client.follows_labels = true;
        return;
      case igtl::Request::kStopImages:
        client.follows_labels = client.follows_labels && !is_labels;
    }
  }

  static void queue(Client& client, Message message) {
    if (client.queue.size() >= kMaxQueued) {
      client.fault = "asks for more than it takes";
      return;
    }
    if (client.queue.empty()) client.progress = Clock::now();
    client.queue.push_back(std::move(message));
  }

  void publish(Clock::time_point now) {
    if (now >= next_state_) {
      is_stopped_ = session_.is_stopped();
      next_state_ = now + kStatePeriod;
    }
    const auto slice = clients_.empty() ? std::nullopt : session_.slice_index();
    std::optional<std::pair<int, Message>> encoded;
    std::vector<EncodedFrame> frames;
    for (Client& client : clients_) {
      if (!client.is_greeted || client.is_stopped != is_stopped_) {
        queue(client, session_.status());
        client.is_greeted = true;
        client.is_stopped = is_stopped_;
      }
      // a client that has not taken the last frame gets the latest one later
      if (!client.queue.empty()) {
        send(client);
        if (!client.queue.empty()) continue;
      }
      queue(client, frame_for(client, frames));
      if (slice && slice != client.slice && now >= client.next_slice) {
        if (!encoded) encoded = {*slice, session_.slice(*slice)};
        queue(client, encoded->second);
        client.slice = slice;
        client.next_slice = now + kSlicePeriod;
      }
      send(client);
    }
    publish_labels(now);
  }

  Message frame_for(Client& client, std::vector<EncodedFrame>& frames) const {
    auto frame = std::ranges::find(frames, client.structures, &EncodedFrame::before);
    if (frame == frames.end()) {
      EncodedFrame encoded{client.structures, client.structures, nullptr};
      encoded.message = std::make_shared<const igtl::MessageBytes>(session_.frame(encoded.after));
      frame = frames.insert(frame, std::move(encoded));
    }
    client.structures = frame->after;
    return frame->message;
  }

  // Labels are encoded on a thread of their own, one message at a time: all of them when a client asks for
  // them, and then the box in which they have changed since the version that it has.
  void publish_labels(Clock::time_point now) {
    if (encoding_.valid()) {
      if (encoding_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
      const Message message = encoding_.get();
      for (Client& client : clients_) {
        if (!std::exchange(client.awaits_encoding, false)) continue;
        if (!client.follows_labels) client.labels.reset();
        if (message == nullptr) continue;
        queue(client, message);
        send(client);
      }
    }
    if (now < next_labels_) return;
    const bool is_awaited =
        std::ranges::any_of(clients_, [](const Client& c) { return c.wants_labels || c.follows_labels; });
    if (!is_awaited) return;
    const auto labels = host_.labels();
    std::shared_ptr<const Bricks<LabelId>> before;
    bool is_due = false;
    for (Client& client : clients_) {
      // the next version waits until a client has taken the one before
      if (!client.queue.empty()) continue;
      if (!client.wants_labels && !(client.follows_labels && client.labels != labels)) continue;
      const auto received = std::exchange(client.wants_labels, false) ? nullptr : client.labels;
      // a client that has another version is next
      if (is_due && received != before) {
        client.wants_labels = received == nullptr;
        continue;
      }
      before = received;
      is_due = client.awaits_encoding = true;
      client.labels = labels;
    }
    if (!is_due) return;
    // clients that were left out come first next time
    std::list<Client> served;
    for (auto client = clients_.begin(); client != clients_.end();) {
      const auto next = std::next(client);
      if (client->awaits_encoding) served.splice(served.end(), clients_, client);
      client = next;
    }
    clients_.splice(clients_.end(), served);
    next_labels_ = now + (before ? kBoxPeriod : kLabelsPeriod);
    encoding_ = std::async(std::launch::async, [labels, before] {
      server::use_ordinary_priority("openigtlink-img");
      return PublishedSession::labels(*labels, before.get());
    });
  }

  static void send(Client& client) {
    while (!client.queue.empty()) {
      const igtl::MessageBytes& bytes = *client.queue.front();
      const ssize_t consumed = ::send(client.socket.get(), bytes.data() + client.sent,
                                      bytes.size() - client.sent, MSG_NOSIGNAL | MSG_DONTWAIT);
      if (consumed < 0) {
        if (errno != EAGAIN && errno != EINTR) client.fault = kLeft;
        return;
      }
      client.progress = Clock::now();
      client.sent += static_cast<std::size_t>(consumed);
      if (client.sent < bytes.size()) return;
      client.queue.pop_front();
      client.sent = 0;
    }
  }

  void drop_faulty() {
    for (const Client& client : clients_)
      if (!client.fault.empty() && client.fault != kLeft)
        log(client.peer + " is dropped: it " + client.fault);
    clients_.remove_if([](const Client& client) { return !client.fault.empty(); });
    clients_count_ = static_cast<int>(clients_.size());
  }
  void log(const std::string& line) const {
    if (options_.log) options_.log(line);
  }

  static constexpr const char* kLeft = "left";  // not reported

  const ViewerHost& host_;
  const PublishedSession session_;
  const OpenIgtLinkOptions options_;
  const FileDescriptor listening_, wake_;
  const int port_;
  const Clock::duration period_;
  std::atomic<bool> ended_{false};
  std::atomic<int> clients_count_{0};
  // on the server's thread
  std::list<Client> clients_;
  bool is_stopped_ = false;
  Clock::time_point next_state_{}, next_labels_{}, next_accept_{};
  std::future<Message> encoding_;
  std::thread thread_;  // last: uses the members above
};

Result<FileDescriptor> listen_at(const OpenIgtLinkOptions& options, int& port) {
  const auto address = server::IpAddress::parse(options.address);
  if (!address)
    return Error{ErrorKind::kBadInput, printable_name(options.address) + " is no numeric address",
                 "OpenIGTLink", "give an address of this machine, such as 127.0.0.1"};
  const auto failed = [&](const char* what) {
    return Error{ErrorKind::kUnavailable, std::string(what) + ": " + std::strerror(errno),
                 "OpenIGTLink at " + options.address + " port " + std::to_string(options.port),
                 "end the program that listens there, or choose another port"};
  };
  FileDescriptor socket(
      ::socket(address->is_v6() ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (socket.get() < 0) return failed("cannot open a socket");
  const int on = 1;
  ::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  sockaddr_storage bound{};
  socklen_t size = sizeof(sockaddr_in);
  if (address->is_v6()) {
    auto& v6 = reinterpret_cast<sockaddr_in6&>(bound);
    v6.sin6_family = AF_INET6;
    v6.sin6_port = htons(static_cast<std::uint16_t>(options.port));
    v6.sin6_scope_id = address->scope_id();
    std::memcpy(&v6.sin6_addr, address->bytes().data(), 16);
    size = sizeof v6;
  } else {
    auto& v4 = reinterpret_cast<sockaddr_in&>(bound);
    v4.sin_family = AF_INET;
    v4.sin_port = htons(static_cast<std::uint16_t>(options.port));
    std::memcpy(&v4.sin_addr, address->bytes().data(), 4);
  }
  if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&bound), size) != 0)
    return failed("cannot bind");
  if (::listen(socket.get(), kBacklog) != 0) return failed("cannot listen");
  if (::getsockname(socket.get(), reinterpret_cast<sockaddr*>(&bound), &size) != 0)
    return failed("has no address");
  port = ntohs(address->is_v6() ? reinterpret_cast<const sockaddr_in6&>(bound).sin6_port
                                : reinterpret_cast<const sockaddr_in&>(bound).sin_port);
  return socket;
}

}  // namespace

Result<std::unique_ptr<OpenIgtLinkServer>> OpenIgtLinkServer::start(const ViewerHost& host,
                                                                    const OpenIgtLinkOptions& options) {
  if (!host.scene().tasks.empty())
    return Error{ErrorKind::kUsage, "clients of OpenIGTLink have no role, and would see what a task hides",
                 "OpenIGTLink", "leave out the task, or publish without OpenIGTLink"};
  if (!(options.rate_hz >= kRates_hz[0] && options.rate_hz <= kRates_hz[1]))
    return Error{ErrorKind::kBadInput, "the rate is outside 1 to 1000 Hz", "OpenIGTLink",
                 "choose a rate within"};
  int port = 0;
  auto listening = listen_at(options, port);
  if (!listening) return listening.error();
  FileDescriptor wake(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  try {
    if (wake.get() >= 0)
      return std::unique_ptr<OpenIgtLinkServer>(
          std::make_unique<Server>(host, options, *std::move(listening), std::move(wake), port));
  } catch (const std::system_error&) {
  }
  return Error{ErrorKind::kUnavailable, "cannot start a thread or open a file descriptor", "OpenIGTLink",
               "close other programs, or raise the limits (ulimit -u, ulimit -n)"};
}

}  // namespace palpate
