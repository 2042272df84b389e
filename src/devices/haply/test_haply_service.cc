#include "haply/test_haply_service.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "haply/test_service_socket.h"
#include "palpate/base/clock.h"

namespace palpate::testing {
namespace {

using ServiceJson = nlohmann::json;

constexpr int kPoll_ms = 2;
constexpr double kMPerMm = 1e-3;
constexpr const char* kServiceDevice = "049D";

bool readable(int socket, int timeout_ms) {
  pollfd requested{socket, POLLIN, 0};
  return ::poll(&requested, 1, timeout_ms) == 1;
}

// listens on this port, or on any free port if 0, which is then stored
int listening(std::uint16_t& port) {
  const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  PALPATE_CHECK(::bind(socket, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0);
  PALPATE_CHECK(::listen(socket, 16) == 0);
  socklen_t size = sizeof address;
  PALPATE_CHECK(::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) == 0);
  port = ntohs(address.sin_port);
  return socket;
}

}  // namespace

struct FakeInverseService::Listener {
  int socket = -1;
  std::thread thread;
};

FakeInverseService::FakeInverseService(const SimulatedDevice& device, std::string version) : plant_(device) {
  start(version);
}

FakeInverseService::~FakeInverseService() {
  stop();
}

HaplySettings FakeInverseService::settings() const {
  HaplySettings settings;
  settings.port = port_;
  settings.old_http_port = http_port_;
  settings.events_port = events_port_;
  return settings;
}

bool FakeInverseService::is_old() const {
  const std::lock_guard lock(mutex_);
  return version_.starts_with("3.0") || version_.starts_with("3.1");
}

void FakeInverseService::start(const std::string& version) {
  {
    const std::lock_guard lock(mutex_);
    version_ = version;
  }
  ended_ = false;
  for (std::uint16_t* port : {&port_, &http_port_, &events_port_}) {
    // also listeners that this version does not serve, so that ports are unchanged after a restart
    auto listener = std::make_unique<Listener>();
    listener->socket = listening(*port);
    listeners_.push_back(std::move(listener));
  }
  for (const auto& listener : listeners_) listener->thread = std::thread([&] { listen(*listener); });
}

void FakeInverseService::intend(const Point<Device>& tip) {
  const std::lock_guard lock(mutex_);
  plant_.intend(tip);
}

void FakeInverseService::close_connections() {
  const std::lock_guard lock(mutex_);
  for (const int socket : sockets_) ::shutdown(socket, SHUT_RDWR);
}

void FakeInverseService::stop() {
  ended_ = true;
  for (const auto& listener : listeners_) {
    listener->thread.join();
    ::close(listener->socket);
  }
  listeners_.clear();
  close_connections();
  std::vector<std::thread> sessions;
  {
    const std::lock_guard lock(mutex_);
    sessions.swap(sessions_);
  }
  for (std::thread& session : sessions) session.join();
}

void FakeInverseService::report_event(const std::string& text) {
  const std::lock_guard lock(mutex_);
  event_ = text;
  ++events_;
}

std::string FakeInverseService::last_message() const {
  const std::lock_guard lock(mutex_);
  return last_message_;
}

void FakeInverseService::listen(Listener& listener) {
  while (!ended_) {
    if (!readable(listener.socket, kPoll_ms)) continue;
    const int socket = ::accept4(listener.socket, nullptr, nullptr, SOCK_CLOEXEC);
    if (socket < 0) continue;
    // duplicated descriptor, which remains valid until nobody can shut it down any more
    const int own = ::fcntl(socket, F_DUPFD_CLOEXEC, 0);
    const std::lock_guard lock(mutex_);
    sockets_.push_back(own);
    sessions_.emplace_back([this, socket, own] {
      serve(socket);
      const std::lock_guard end(mutex_);
      std::erase(sockets_, own);
      ::shutdown(own, SHUT_RDWR);
      ::close(own);
    });
  }
}

/// WebSocket session of one client.
class FakeInverseService::Session {
 public:
  Session(FakeInverseService& service, TestServiceSocket& socket) : service_(service), socket_(socket) {}

  void run() {
    if (!answer(true)) return enter_idle();
    std::string text;
    while (!service_.ended_) {
      if (service_.deaf) {
        std::this_thread::sleep_for(std::chrono::milliseconds(kPoll_ms));
      } else {
        const auto read = socket_.read_for(std::chrono::milliseconds(kPoll_ms), text);
        if (read == TestServiceSocket::Read::kLost) break;
        if (read == TestServiceSocket::Read::kMessage) {
          last_ns_ = monotonic_ns();
          take(text);
          ++service_.messages_;
          bool fine = true;
          for (int n = 0; fine && !service_.silent && n < service_.answers_each; ++n) fine = answer(false);
          if (!fine) break;
        }
      }
      if (!push()) break;
      if (monotonic_ns() - last_ns_ > kIdle_ns) enter_idle();
    }
    enter_idle();
    socket_.close();
  }

 private:
  void take(const std::string& text) {
    const ServiceJson message = ServiceJson::parse(text, nullptr, false);
    bool fine = message.is_object() && message.contains("session") == first_;
    if (fine && first_)
      fine = message["session"].is_object() && message["session"].dump().find("name") != std::string::npos &&
             message["session"].dump().find("permutation") != std::string::npos;
    first_ = false;
    const char* key = service_.is_old() ? "values" : "vector";
    try {
      const auto& own = message.at("inverse3").at(0);
      const auto& force = own.at("commands").at("set_cursor_force").at(key);
      fine = fine && own.at("device_id") == kServiceDevice;
      DeviceCommand command;
      command.force_N = Vector<Device>(force.at("x").get<double>(), force.at("y").get<double>(),
                                       force.at("z").get<double>());
      if (fine) deliver(command, false);
    } catch (const ServiceJson::exception&) {
      fine = false;
    }
    service_.violations_ += !fine;
    const std::lock_guard lock(service_.mutex_);
    service_.last_message_ = text;
  }

  void enter_idle() {
    if (service_.force_N_ != 0 || !idle_) deliver({}, true);
    idle_ = true;
  }

  void deliver(const DeviceCommand& command, bool idle) {
    const std::lock_guard lock(service_.mutex_);
    const DeviceSample sample = service_.plant_.advance(service_.acting_);
    service_.acting_ = command;
    service_.force_N_ = command.force_N.norm();
    service_.delivered_.add({monotonic_ns(), command, sample, idle});
    idle_ = idle;
  }

  // sends all states due since the last call, sampled now
  bool push() {
    const double hz = service_.pushes_hz;
    const std::int64_t now_ns = monotonic_ns();
    if (!(hz > 0)) {
      pushed_ns_ = now_ns;
      return true;
    }
    bool fine = true;
    for (; fine && pushed_ns_ + std::llround(1e9 / hz) <= now_ns; pushed_ns_ += std::llround(1e9 / hz))
      fine = answer(false);
    return fine;
  }

  bool answer(bool inventory) {
    DeviceSample sample;
    {
      const std::lock_guard lock(service_.mutex_);
      sample = service_.plant_.advance(service_.acting_);
    }
    const std::int64_t made_ns = monotonic_ns();
    if (service_.encodes_time)
      sample.tip[2] = 1e-6 * static_cast<double>(made_ns % FakeInverseService::kEra_ns);
    std::string text = service_.state_text(sample, inventory);
    if (service_.breaks_json) text.resize(text.size() / 2);
    if (service_.says_other) text = R"({"hello":[1,2,3]})";
    const bool at_once = hoard_.empty();
    hoard_.push_back(std::move(text));
    if (service_.withholds_states && !inventory) return true;
    std::string frames;
    for (const std::string& each : hoard_) frames += service_frame(each);
    hoard_.clear();
    const bool fine = socket_.write_raw(frames);
    if (at_once)
      service_.max_late_ms_ =
          std::max(service_.max_late_ms_.load(), 1e-6 * static_cast<double>(monotonic_ns() - made_ns));
    return fine;
  }

  FakeInverseService& service_;
  TestServiceSocket& socket_;
  bool first_ = true, idle_ = true;
  std::int64_t last_ns_ = monotonic_ns(), pushed_ns_ = last_ns_;
  std::vector<std::string> hoard_;
};

void FakeInverseService::serve(int handle) {
  TestServiceSocket socket(handle);
  const std::uint16_t port = socket.local_port();
  const bool at_websocket = port == port_;
  if (!socket.read_request()) return;
  if (at_websocket && socket.is_upgrade()) {
    if (!socket.accept()) return;
    ++connections_;
    Session(*this, socket).run();
    return;
  }
  if (port == events_port_ && !is_old() && socket.is_upgrade()) {
    bool fine = socket.accept();
    ++event_listeners_;
    for (int reported = events_; fine && !ended_;
         std::this_thread::sleep_for(std::chrono::milliseconds(kPoll_ms))) {
      if (reported == events_) continue;
      const std::lock_guard lock(mutex_);
      reported = events_;
      fine = socket.write(event_);
    }
    return;
  }
  const bool requested = is_old() ? !at_websocket && socket.target() == "/3.0/version"
                                  : at_websocket && socket.target() == "/3.5/version";
  if (!requested) return socket.answer(404, "");
  const std::lock_guard lock(mutex_);
  socket.answer(200, "{\"version\":\"" + version_ + "\"}");
}

std::string FakeInverseService::state_text(const DeviceSample& sample, bool inventory) const {
  const auto metres = [](const Eigen::Vector3d& mm) {
    return ServiceJson{{"x", mm.x() * kMPerMm}, {"y", mm.y() * kMPerMm}, {"z", mm.z() * kMPerMm}};
  };
  ServiceJson device{{"device_id", kServiceDevice},
                     {"state",
                      {{"cursor_position", metres(sample.tip.eigen())},
                       {"cursor_velocity", {{"x", 0}, {"y", 0}, {"z", 0}}},
                       {"control_mode", "cursor_force"}}},
                     {"status",
                      {{"calibrated", calibrated.load()},
                       {"in_use", in_use.load()},
                       {"power_supply", power.load()},
                       {"ready", ready.load()},
                       {"started", true}}}};
  if (inventory) device["config"] = {{"type", "inverse3"}, {"handedness", "right"}};
  if (odd_position) device["state"]["cursor_position"] = {{"x", nullptr}, {"y", "nan"}, {"z", 1e300}};
  ServiceJson message{{"inverse3", ServiceJson::array()}, {"verse_grip", ServiceJson::array()}};
  if (inventory) message["session_id"] = 7;
  if (present) message["inverse3"].push_back(device);
  message["verse_grip"].push_back(
      {{"device_id", "61548"},
       {"state",
        {{"button", buttons.load() != 0},
         {"hall", 0},
         {"orientation",
          {{"w", std::cos(turned_rad / 2)}, {"x", 0}, {"y", 0}, {"z", std::sin(turned_rad / 2)}}}}}});
  return message.dump();
}

}  // namespace palpate::testing
