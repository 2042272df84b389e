// Round trip of the Haply driver on loopback, with the servo attached, compared with a bare Boost.Beast echo,
// alternating in one run. See README.md.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "json_file.h"
#include "palpate/base/clock.h"
#include "palpate/haply/haply_driver.h"
#include "palpate/loading/loading.h"
#include "palpate/scene/scene.h"
#include "palpate/servo/realtime.h"
#include "palpate/servo/servo_loop.h"

namespace palpate::bench {
namespace {

namespace beast = boost::beast;
using tcp = boost::asio::ip::tcp;
using WebSocket = beast::websocket::stream<tcp::socket>;

constexpr double kBall_mm = 15;
// same format and length as the driver's request
constexpr const char* kRequest =
    R"({"inverse3":[{"device_id":"049D","commands":{"set_cursor_force":{"values":{"x":0.1234567,"y":0,"z":0.7654321}}}}]})";
// the tip is a millimetre deep in the ball at the centre of the device's workspace: a direct method generates
// force from the first tick on
constexpr const char* kState =
    R"({"inverse3":[{"device_id":"049D","state":{"cursor_position":{"x":0.014,"y":-0.12,"z":0.15},)"
    R"("cursor_velocity":{"x":0,"y":0,"z":0},"control_mode":"cursor_force"},"status":{"calibrated":true,)"
    R"("in_use":false,"power_supply":true,"ready":true,"started":true}}],"verse_grip":[{"device_id":"61548",)"
    R"("state":{"button":false,"hall":0,"orientation":{"w":1,"x":0,"y":0,"z":0}}}]})";

/// Replies to every message at once: an echo at /echo, otherwise a constant state, which is the least a
/// service can do. Both use the same code.
class Server {
 public:
  Server() : acceptor_(context_, tcp::endpoint(boost::asio::ip::address_v4::loopback(), 0)) {
    thread_ = std::thread([this] { accept(); });
  }
  ~Server() {
    ended_ = true;
    boost::system::error_code ignored;
    // unblocks the acceptor
    tcp::socket(context_).connect(acceptor_.local_endpoint(), ignored);
    thread_.join();
    for (std::thread& each : served_) each.join();
  }
  std::uint16_t port() const { return acceptor_.local_endpoint().port(); }

 private:
  void accept() {
    while (!ended_) {
      tcp::socket socket(context_);
      boost::system::error_code error;
      acceptor_.accept(socket, error);
      if (error || ended_) continue;
      served_.emplace_back([this, own = std::move(socket)]() mutable { serve(std::move(own)); });
    }
  }
  void serve(tcp::socket socket) {
    boost::system::error_code error;
    socket.set_option(tcp::no_delay(true), error);
    beast::flat_buffer buffer;
    beast::http::request<beast::http::string_body> request;
    beast::http::read(socket, buffer, request, error);
    if (error) return;
    if (!beast::websocket::is_upgrade(request)) {
      beast::http::response<beast::http::string_body> answer(beast::http::status::ok, 11);
      answer.body() = "3.1.0";
      answer.prepare_payload();
      beast::http::write(socket, answer, error);
      return;
    }
    const bool echoes = request.target() == "/echo";
    WebSocket stream(std::move(socket));
    stream.accept(request, error);
    stream.text(true);
    if (!echoes) stream.write(boost::asio::buffer(std::string_view(kState)), error);
    while (!error) {
      beast::flat_buffer message;
      stream.read(message, error);
      if (error) return;
      if (echoes)
        stream.write(message.data(), error);
      else
        stream.write(boost::asio::buffer(std::string_view(kState)), error);
    }
  }

  boost::asio::io_context context_;
  tcp::acceptor acceptor_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
  std::vector<std::thread> served_;
};

/// A blocking client that repeats the same request. Appends the duration of each round trip, us.
/// @param target  "/echo", or "/" for the service's state, which is received but not parsed
void bare_round_trips(std::uint16_t port, const char* target, int count, bool realtime,
                      std::vector<double>& took_us) {
  std::thread([&] {
    make_this_thread_realtime({.fifo = realtime, .lock_memory = realtime});
    boost::asio::io_context context(1);
    WebSocket stream(context);
    beast::get_lowest_layer(stream).connect({boost::asio::ip::address_v4::loopback(), port});
    beast::get_lowest_layer(stream).set_option(tcp::no_delay(true));
    stream.handshake("127.0.0.1", target);
    stream.text(true);
    beast::flat_buffer buffer;
    // the inventory
    if (std::string_view(target) == "/") stream.read(buffer);
    buffer.consume(buffer.size());
    for (int n = 0; n < count; ++n) {
      const std::int64_t started_ns = monotonic_ns();
      stream.write(boost::asio::buffer(std::string_view(kRequest)));
      stream.read(buffer);
      buffer.consume(buffer.size());
      took_us.push_back(1e-3 * static_cast<double>(monotonic_ns() - started_ns));
    }
  }).join();
}

/// A driver with timed updates: from one to the next there is a whole round trip, including the tick.
class TimedDriver final : public DeviceDriver {
 public:
  explicit TimedDriver(DeviceDriver& driver) : driver_(driver) {}
  std::span<const DeviceInfo> devices() const override { return driver_.devices(); }
  Result<void> open(bool may_move) override { return driver_.open(may_move); }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override {
    Timed timed(servo, *this);
    driver_.run(timed, clock);
  }
  void halt() noexcept override { driver_.halt(); }
  void resume(std::uint64_t newest) noexcept override { driver_.resume(newest); }

  /// Durations, us; preallocated.
  std::vector<double> took_us;
  std::atomic<std::size_t> count{0};

 private:
  class Timed final : public ServoFunction {
   public:
    Timed(ServoFunction& servo, TimedDriver& driver) : servo_(servo), driver_(driver) {}
    void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
      const std::int64_t now_ns = monotonic_ns();
      const std::size_t n = driver_.count.load(std::memory_order_relaxed);
      if (last_ns_ != 0 && n < driver_.took_us.size()) {
        driver_.took_us[n] = 1e-3 * static_cast<double>(now_ns - last_ns_);
        driver_.count.store(n + 1, std::memory_order_release);
      }
      last_ns_ = now_ns;
      servo_.update(samples, commands);
    }

   private:
    ServoFunction& servo_;
    TimedDriver& driver_;
    std::int64_t last_ns_ = 0;
  };

  DeviceDriver& driver_;
};

/// A servo that returns no force, and the clock of a run that ends after a number of samples.
class Nothing final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> /*samples*/,
              std::span<DeviceCommand> commands) noexcept override {
    std::ranges::fill(commands, DeviceCommand{});
  }
};
class UntilFull final : public ServoClock {
 public:
  explicit UntilFull(const TimedDriver& driver) : driver_(driver) {}
  bool wait() noexcept override { return !stopped(); }
  bool stopped() const noexcept override { return driver_.count >= driver_.took_us.size(); }

 private:
  const TimedDriver& driver_;
};

void driven_round_trips(TimedDriver& driver, bool realtime, std::vector<double>& took_us) {
  std::thread([&] {
    make_this_thread_realtime({.fifo = realtime, .lock_memory = realtime});
    Nothing nothing;
    UntilFull clock(driver);
    driver.run(nothing, clock);
  }).join();
  took_us.insert(took_us.end(), driver.took_us.begin(), driver.took_us.end());
}

Result<std::shared_ptr<const Model>> ball() {
  LabelMap map;
  GridGeometry grid;
  grid.dims.fill(41);
  grid.spacing_mm.setOnes();
  grid.origin = Point<Patient>(-20, -20, -20);
  Volume<LabelId> labels(grid);
  for (int k = 0; k < 41; ++k)
    for (int j = 0; j < 41; ++j)
      for (int i = 0; i < 41; ++i)
        if (Eigen::Vector3d(i - 20, j - 20, k - 20).norm() <= kBall_mm) labels.at(i, j, k) = 1;
  map.layers.push_back(std::move(labels));
  map.segments.push_back({1, "ball", {}, 0, 1});
  const auto scene = parse_scene(
      "title = \"ball\"\n[data]\nlabels = \"ball.nrrd\"\n[[tissue]]\nname = \"ball\"\nlabels = [1]\n"
      "stiffness = 1\nfriction = 0.1\n",
      "ball");
  if (!scene) return scene.error();
  auto model = build_model(*scene, &map, nullptr);
  if (!model) return model.error();
  constexpr std::array kDirect{ForceMethod::kTrilinear};
  return prepared_with_cache(*std::move(model), kDirect);
}

double part_of(std::vector<double> values, double part) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

int run(int argc, char** argv) {
  CLI::App app("The Haply driver's round trip against a bare echo");
  int rounds = 40, exchanges = 500;
  bool realtime = true;
  std::string json;
  app.add_option("--rounds", rounds, "How often the two take turns")->check(CLI::Range(1, 1000));
  app.add_option("--exchanges", exchanges, "Round trips of each in a turn")->check(CLI::Range(100, 1000000));
  app.add_flag("!--no-realtime", realtime, "Ask for no real-time scheduling");
  app.add_option("--json", json, "File for the figures");
  CLI11_PARSE(app, argc, argv);

  const auto model = ball();
  if (!model) {
    std::fprintf(stderr, "%s\n", model.error().message().c_str());
    return 1;
  }
  Server server;
  HaplySettings settings;
  settings.port = settings.old_http_port = server.port();
  settings.max_rate_hz = 1e6;
  HaplyDriver driver(settings);
  TimedDriver timed(driver);
  if (const auto opened = timed.open(false); !opened) {
    std::fprintf(stderr, "%s\n", opened.error().message().c_str());
    return 1;
  }
  std::vector<double> bare_us, unread_us, alone_us, driven_us;
  double compute_us = 0;
  for (int round = 0; round < rounds; ++round) {
    bare_round_trips(server.port(), "/echo", exchanges, realtime, bare_us);
    bare_round_trips(server.port(), "/", exchanges, realtime, unread_us);
    const auto begin = [&] {
      timed.took_us.assign(static_cast<std::size_t>(exchanges), 0);
      timed.count = 0;
    };
    begin();
    driven_round_trips(timed, realtime, alone_us);
    begin();
    Parameters parameters;
    parameters.method = ForceMethod::kTrilinear;
    auto loop = ServoLoop::start(*model, timed, parameters, {WorkspaceSettings{}},
                                 {.realtime = realtime, .ring_s = 1});
    if (!loop) {
      std::fprintf(stderr, "%s\n", loop.error().message().c_str());
      return 1;
    }
    while (timed.count < timed.took_us.size()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    compute_us += (*loop)->health().compute.p50_us / rounds;
    (*loop)->stop();
    driven_us.insert(driven_us.end(), timed.took_us.begin(), timed.took_us.end());
  }

  nlohmann::json figures;
  std::printf("%-28s %10s %10s\n", "round trip, us", "p50", "p99");
  for (const auto& [name, values] :
       {std::pair("bare echo", &bare_us), std::pair("a state, not understood", &unread_us),
        std::pair("driver without servo", &alone_us), std::pair("driver with servo", &driven_us)}) {
    const double p50 = part_of(*values, 0.5), p99 = part_of(*values, 0.99);
    std::printf("%-28s %10.1f %10.1f\n", name, p50, p99);
    figures[name] = {{"p50_us", p50}, {"p99_us", p99}, {"exchanges", values->size()}};
  }
  const double p50 = part_of(driven_us, 0.5) / part_of(bare_us, 0.5);
  const double p99 = part_of(driven_us, 0.99) / part_of(bare_us, 0.99);
  std::printf("%-28s %10.2f %10.2f\n", "driver with servo / echo", p50, p99);
  std::printf("the tick itself takes %.1f us\n", compute_us);
  figures["tick_us"] = compute_us;
  figures["ratio"] = {{"p50", p50}, {"p99", p99}};
  return write_json("haply_bench", json, figures);
}

}  // namespace
}  // namespace palpate::bench

int main(int argc, char** argv) {
  return palpate::bench::run(argc, argv);
}
