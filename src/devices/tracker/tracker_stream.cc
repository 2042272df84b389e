#include "palpate/tracker/tracker_stream.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <mutex>
#include <set>
#include <system_error>
#include <thread>
#include <utility>

#include "palpate/base/clock.h"
#include "palpate/base/printable.h"
#include "palpate/openigtlink/encoding.h"
#include "palpate/openigtlink/messages.h"

namespace palpate {
namespace {

constexpr int kCheckInterval_ms = 20;
constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kRetry_ns = kSecond_ns / 5, kConnecting_ns = 3 * kSecond_ns,
                       kSilent_ns = 5 * kSecond_ns;
constexpr std::int64_t kUnseen_ns = static_cast<std::int64_t>(TrackerStream::kUnseen_s * 1e9);
constexpr std::size_t kMaxNames = 64, kMaxNameLength = 128;
// size of a device name field in a message
constexpr std::size_t kShortName = 20;

// frame of the cameras; the Tracker frame is the reference's, if there is one
struct Cameras {};

/// Owning socket descriptor.
class Socket {
 public:
  explicit Socket(int number = -1) : number_(number) {}
  Socket(Socket&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Socket& operator=(Socket&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Socket() {
    if (number_ >= 0) ::close(number_);
  }
  int number() const { return number_; }

 private:
  int number_;
};

struct FoundAddresses {
  addrinfo* first = nullptr;
  ~FoundAddresses() {
    if (first != nullptr) ::freeaddrinfo(first);
  }
};

// whether a transform's name is the requested one, or its truncation in an old message
bool is_called(const std::string& name, const std::string& requested) {
  return name == requested || (requested.size() > kShortName && name == requested.substr(0, kShortName));
}

}  // namespace

std::string TrackerAddress::text() const {
  const bool is_v6 = host.find(':') != std::string::npos;
  return (is_v6 ? "[" + host + "]" : host) + ":" + std::to_string(port);
}

std::optional<TrackerAddress> parse_tracker_address(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos || colon == 0) return {};
  const std::string port = text.substr(colon + 1);
  if (port.empty() || port.size() > 5 || port.find_first_not_of("0123456789") != std::string::npos) return {};
  TrackerAddress address{text.substr(0, colon), std::stoi(port)};
  if (address.host.starts_with('[') && address.host.ends_with(']'))
    address.host = address.host.substr(1, address.host.size() - 2);
  else if (address.host.find_first_of(":/") != std::string::npos)
    return {};
  if (address.host.empty() || address.port < 1 || address.port > 65535) return {};
  return address;
}

class TrackerStream::Core {
 public:
  Core(const TrackerSettings& settings, std::function<void(const MarkersPose&)> on_pose)
      : settings_(settings), on_pose_(std::move(on_pose)) {}
  ~Core() {
    end_.store(true);
    if (reader_.joinable()) reader_.join();
  }

  Result<void> open(double patience_s, const Progress& progress) {
    if (reader_.joinable()) return {};
    try {
      reader_ = std::thread([this] { follow(); });
    } catch (const std::system_error& error) {
      return Error{ErrorKind::kUnavailable, std::string("cannot start a thread: ") + error.what(), "tracker",
                   "close other programs, or raise the process limit (ulimit -u)"};
    }
    const auto patience_ns = std::llround(patience_s * 1e9);
    std::int64_t until_ns = monotonic_ns() + patience_ns;
    for (bool was_connected = false; !is_ready();) {
      if (progress.stopped()) return Progress::interrupted();
      if (monotonic_ns() > until_ns)
        if (auto missing = missing_pose("")) return *std::move(missing);
      // from then on the time limit applies to the tool
      if (is_connected() && !std::exchange(was_connected, true)) until_ns = monotonic_ns() + patience_ns;
      std::this_thread::sleep_for(std::chrono::milliseconds(kCheckInterval_ms));
    }
    return {};
  }

  std::optional<Error> failure() const {
    return missing_pose("; the connection is retried and resumes by itself");
  }

  std::vector<std::string> received_transforms() const {
    const std::lock_guard lock(mutex_);
    std::vector<std::string> names;
    for (const std::string& name : received_names_) names.push_back(printable_name(name));
    return names;
  }

 private:
  struct Observed {
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
    Eigen::Vector3d shift_mm = Eigen::Vector3d::Zero();
    std::uint64_t stamp = 0;
    std::int64_t at_ns = -kSecond_ns;
  };

  /// @param continues  remark about automatic retries
  std::optional<Error> missing_pose(const char* continues) const {
    const std::lock_guard lock(mutex_);
    const auto unavailable = [this](std::string what, std::string remedy) {
      return Error{ErrorKind::kUnavailable, std::move(what), "tracker " + settings_.address.text(),
                   std::move(remedy)};
    };
    const std::int64_t now_ns = monotonic_ns();
    if (!is_connected_) return unavailable(disconnect_reason_, disconnect_remedy_ + continues);
    if (now_ns - pose_ns_ <= kUnseen_ns) return std::nullopt;
    if (received_names_.empty())
      return unavailable("sends no transforms",
                         "make its server send TRANSFORM messages, and start tracking");
    for (const std::string& requested : {settings_.transform, settings_.reference}) {
      if (requested.empty()) continue;
      if (std::ranges::none_of(received_names_,
                               [&](const std::string& name) { return is_called(name, requested); })) {
        std::string all;
        for (const std::string& name : received_names_)
          all += (all.empty() ? "" : ", ") + printable_name(name);
        return unavailable("sends no " + printable_name(requested), "it sends: " + all);
      }
    }
    // no pose is expected
    if (settings_.transform.empty()) return std::nullopt;
    if (now_ns - tool_.at_ns > kUnseen_ns)
      return unavailable(printable_name(settings_.transform) + " is not visible",
                         "turn the tool's markers towards the tracker, and clear the view");
    if (now_ns - reference_.at_ns > kUnseen_ns)
      return unavailable(printable_name(settings_.reference) + " is not visible",
                         "turn the patient's markers towards the tracker, and clear the view");
    return unavailable("sends " + printable_name(settings_.transform) + " and " +
                           printable_name(settings_.reference) + " with different time stamps",
                       "make its server send both from one frame (in PLUS: from one data collection device)");
  }

  bool is_connected() const {
    const std::lock_guard lock(mutex_);
    return is_connected_;
  }
  bool is_ready() const {
    const std::lock_guard lock(mutex_);
    return is_connected_ && (settings_.transform.empty() ? !received_names_.empty() : pose_ns_ > 0);
  }
  void not_connected(std::string why, std::string remedy) {
    const std::lock_guard lock(mutex_);
    is_connected_ = false;
    disconnect_reason_ = std::move(why);
    disconnect_remedy_ = std::move(remedy);
  }

  // ---- on the stream's own thread
  void follow() {
    while (!end_.load()) {
      if (Socket socket = connect(); socket.number() >= 0) read(socket.number());
      for (const std::int64_t until = monotonic_ns() + kRetry_ns; !end_.load() && monotonic_ns() < until;)
        std::this_thread::sleep_for(std::chrono::milliseconds(kCheckInterval_ms));
    }
  }

  // waits until the descriptor is readable or writable; false: timeout, or the stream ends
  bool await(int file, short what, std::int64_t until_ns) const {
    while (!end_.load() && monotonic_ns() < until_ns) {
      pollfd waiting{file, what, 0};
      if (::poll(&waiting, 1, kCheckInterval_ms) > 0) return true;
    }
    return false;
  }

  Socket connect() {
    const char* remedy = "check the address, and whether the tracking server is running";
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    FoundAddresses found;
    const TrackerAddress& address = settings_.address;
    if (const int failed =
            ::getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &hints, &found.first);
        failed != 0) {
      not_connected(std::string("is not found: ") + ::gai_strerror(failed), remedy);
      return Socket();
    }
    int failure = EHOSTUNREACH;
    for (const addrinfo* each = found.first; each != nullptr && !end_.load(); each = each->ai_next) {
      Socket socket(
          ::socket(each->ai_family, each->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, each->ai_protocol));
      if (socket.number() < 0) continue;
      if (::connect(socket.number(), each->ai_addr, each->ai_addrlen) != 0 && errno != EINPROGRESS) {
        failure = errno;
        continue;
      }
      socklen_t size = sizeof failure;
      if (!await(socket.number(), POLLOUT, monotonic_ns() + kConnecting_ns))
        failure = ETIMEDOUT;
      else
        ::getsockopt(socket.number(), SOL_SOCKET, SO_ERROR, &failure, &size);
      if (failure == 0) return socket;
    }
    not_connected(std::string("does not answer: ") + std::strerror(failure), remedy);
    return Socket();
  }

  void read(int file) {
    const int enable = 1;
    ::setsockopt(file, IPPROTO_TCP, TCP_NODELAY, &enable, sizeof enable);
    const auto greeting = igtl::greeting();
    // fits into the send buffer of a new connection
    if (::send(file, greeting.data(), greeting.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(greeting.size()))
      return not_connected("has closed the connection", "check whether the tracking server is still running");
    {
      const std::lock_guard lock(mutex_);
      is_connected_ = true;
      received_names_.clear();
      tool_ = {};
      reference_ = {};
    }
    igtl::PoseReader messages;
    std::vector<std::uint8_t> bytes(1 << 16);
    while (!end_.load()) {
      if (!await(file, POLLIN, monotonic_ns() + kSilent_ns))
        return not_connected("has sent nothing for 5 s",
                             "check whether the tracking server is still running");
      const ssize_t received = ::recv(file, bytes.data(), bytes.size(), 0);
      if (received < 0 && (errno == EAGAIN || errno == EINTR)) continue;
      if (received <= 0)
        return not_connected("has closed the connection",
                             "check whether the tracking server is still running");
      const std::int64_t now_ns = monotonic_ns();
      const std::uint64_t damaged_before = messages.damaged();
      const auto used = messages.consume(std::span(bytes).first(static_cast<std::size_t>(received)),
                                         [&](const igtl::PoseMessage& message) { consume(message, now_ns); });
      if (!used) return not_connected(used.error().what, used.error().remedy);
      if (messages.damaged() > damaged_before && messages.damaged() >= kMaxDamaged)
        return not_connected("sends damaged messages: their checksums are wrong",
                             "check its connection; restart its server");
    }
  }

  void consume(const igtl::PoseMessage& message, std::int64_t now_ns) {
    MarkersPose pose;
    {
      const std::lock_guard lock(mutex_);
      if (received_names_.size() < kMaxNames) received_names_.insert(message.name.substr(0, kMaxNameLength));
      if (!message.is_tracked) return;
      const bool is_tool = !settings_.transform.empty() && is_called(message.name, settings_.transform),
                 is_reference = !settings_.reference.empty() && is_called(message.name, settings_.reference);
      if (!is_tool && !is_reference) return;
      (is_tool ? tool_ : reference_) = {message.rotation, message.at_mm, message.stamp, now_ns};
      const Transform<Cameras, TrackedTool> tool(tool_.rotation, tool_.shift_mm);
      if (settings_.reference.empty()) {
        pose.tracker_from_tool = {tool_.rotation, tool_.shift_mm};
      } else {
        // both poses of one frame
        if (now_ns - tool_.at_ns > kUnseen_ns || now_ns - reference_.at_ns > kUnseen_ns) return;
        const std::uint64_t apart =
            std::max(tool_.stamp, reference_.stamp) - std::min(tool_.stamp, reference_.stamp);
        if (apart > kMaxApart) return;
        const Transform<Cameras, Tracker> reference(reference_.rotation, reference_.shift_mm);
        pose.tracker_from_tool = reference.inverse() * tool;
      }
      pose_ns_ = now_ns;
    }
    pose.at_ns = now_ns;
    on_pose_(pose);
  }

  // 5 ms in 2^-32 s
  static constexpr std::uint64_t kMaxApart = (std::uint64_t{1} << 32) / 200;
  static constexpr std::uint64_t kMaxDamaged = 10;

  const TrackerSettings settings_;
  const std::function<void(const MarkersPose&)> on_pose_;
  std::atomic<bool> end_{false};
  mutable std::mutex mutex_;
  // guarded by mutex_
  bool is_connected_ = false;
  std::string disconnect_reason_ = "is not connected yet",
              disconnect_remedy_ = "check the address, and whether the tracking server is running";
  std::set<std::string> received_names_;
  Observed tool_, reference_;
  std::int64_t pose_ns_ = 0;  // time of the last pose passed on; 0: none yet
  std::thread reader_;
};

TrackerStream::TrackerStream(const TrackerSettings& settings, std::function<void(const MarkersPose&)> on_pose)
    : core_(std::make_unique<Core>(settings, std::move(on_pose))) {}
TrackerStream::~TrackerStream() = default;

Result<void> TrackerStream::open(double patience_s, const Progress& progress) {
  return core_->open(patience_s, progress);
}
std::optional<Error> TrackerStream::failure() const {
  return core_->failure();
}
std::vector<std::string> TrackerStream::received_transforms() const {
  return core_->received_transforms();
}

}  // namespace palpate
