#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "haply/connection.h"
#include "haply/test_service_socket.h"
#include "palpate/base/check.h"
#include "palpate/base/clock.h"

namespace palpate::haply {
namespace {

using palpate::testing::service_frame;
using palpate::testing::TestServiceSocket;
using std::chrono::milliseconds;

/// Accepts one connection and writes raw bytes.
class RawService {
 public:
  RawService() : listening_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    PALPATE_CHECK(::bind(listening_, reinterpret_cast<sockaddr*>(&address), size) == 0 &&
                  ::listen(listening_, 1) == 0 &&
                  ::getsockname(listening_, reinterpret_cast<sockaddr*>(&address), &size) == 0);
    settings_.port = ntohs(address.sin_port);
  }
  const HaplySettings& settings() const { return settings_; }
  /// Sends pieces with a pause after each, then calls `then` with the socket.
  template <class Then>
  void serve(std::vector<std::string> pieces, milliseconds pause, Then then) {
    thread_ = std::thread([this, pieces = std::move(pieces), pause, then] {
      TestServiceSocket socket(::accept4(listening_, nullptr, nullptr, SOCK_CLOEXEC));
      EXPECT_TRUE(socket.read_request() && socket.accept());
      for (const std::string& piece : pieces) {
        std::this_thread::sleep_for(pause);
        EXPECT_TRUE(socket.write_raw(piece));
      }
      then(socket);
    });
  }
  ~RawService() {
    thread_.join();
    ::close(listening_);
  }

 private:
  int listening_;
  HaplySettings settings_;
  std::thread thread_;
};

/// Reads one text message, for two seconds at most.
void read_text(TestServiceSocket& socket) {
  std::string text;
  EXPECT_EQ(socket.read_for(milliseconds(2000), text), TestServiceSocket::Read::kMessage);
}

/// Next message within two seconds, polled as by the driver.
/// @param nothings  number of calls without a message
Connection::Received next(Connection& connection, std::string& text, int& nothings) {
  const std::int64_t end_ns = monotonic_ns() + 2'000'000'000;
  while (monotonic_ns() < end_ns) {
    const auto received = connection.receive(text, monotonic_ns() + 1'000'000);
    if (received != Connection::Received::kNothing) return received;
    ++nothings;
  }
  return Connection::Received::kNothing;
}

// a message in fragments, with pauses longer than any timeout: within its header, its length, its payload and
// between its frames, and with a ping in between
TEST(HaplyConnection, AssemblesFragmentedMessages) {
  const std::string long_text(300, 'a'), all = service_frame(long_text) + service_frame("one", 1, false) +
                                               service_frame("?", 9) + service_frame("two", 0);
  std::vector<std::string> pieces;
  std::size_t from = 0;
  for (const std::size_t to :
       {std::size_t{1}, std::size_t{2}, std::size_t{3}, std::size_t{4}, std::size_t{100}, std::size_t{304},
        std::size_t{305}, std::size_t{308}, std::size_t{310}, all.size() - 2, all.size()}) {
    pieces.push_back(all.substr(from, to - from));
    from = to;
  }
  std::atomic<bool> answered{false};
  RawService service;
  service.serve(pieces, milliseconds(5), [&](TestServiceSocket& socket) {
    read_text(socket);
    answered = socket.pong() == "?";
  });
  auto connection = Connection::open(service.settings(), service.settings().port);
  ASSERT_TRUE(connection) << connection.error().message();
  std::string text;
  int nothings = 0;
  ASSERT_EQ(next(**connection, text, nothings), Connection::Received::kMessage);
  EXPECT_EQ(text, long_text);
  ASSERT_EQ(next(**connection, text, nothings), Connection::Received::kMessage);
  EXPECT_EQ(text, "onetwo");
  EXPECT_GT(nothings, 5);
  ASSERT_TRUE((*connection)->send("done"));
  for (int n = 0; n < 2000 && !answered; ++n) std::this_thread::sleep_for(milliseconds(1));
  EXPECT_TRUE(answered);
}

// messages received together are returned one by one, even if the connection is lost afterwards
TEST(HaplyConnection, TwoMessagesAtOnceAreTwo) {
  RawService service;
  service.serve({service_frame("first") + service_frame("second") + service_frame("third")}, milliseconds(0),
                read_text);
  auto connection = Connection::open(service.settings(), service.settings().port);
  ASSERT_TRUE(connection);
  std::string text;
  int nothings = 0;
  for (const char* expected : {"first", "second", "third"}) {
    ASSERT_EQ(next(**connection, text, nothings), Connection::Received::kMessage);
    EXPECT_EQ(text, expected);
  }
  EXPECT_EQ((*connection)->receive(text, monotonic_ns() + 1'000'000), Connection::Received::kNothing);
  ASSERT_TRUE((*connection)->send("done"));
}

TEST(HaplyConnection, AClosedOneStaysLost) {
  for (const bool politely : {true, false}) {
    RawService service;
    service.serve({service_frame("last")}, milliseconds(0), [&](TestServiceSocket& socket) {
      if (politely)
        socket.write_raw(service_frame("", 8));
      else
        socket.close();
    });
    auto connection = Connection::open(service.settings(), service.settings().port);
    ASSERT_TRUE(connection);
    std::string text;
    int nothings = 0;
    ASSERT_EQ(next(**connection, text, nothings), Connection::Received::kMessage);
    ASSERT_EQ(next(**connection, text, nothings), Connection::Received::kLost);
    EXPECT_EQ((*connection)->receive(text, monotonic_ns() + 1'000'000), Connection::Received::kLost);
    EXPECT_FALSE((*connection)->send("more"));
  }
}

// sending to a service that does not read is bounded in time
TEST(HaplyConnection, SendToAStalledPeerTimesOut) {
  std::atomic<bool> ended{false};
  RawService service;
  service.serve({}, milliseconds(0), [&](TestServiceSocket&) {
    for (int n = 0; n < 10000 && !ended; ++n) std::this_thread::sleep_for(milliseconds(1));
  });
  auto connection = Connection::open(service.settings(), service.settings().port);
  ASSERT_TRUE(connection);
  const std::string much(60000, 'x');
  int sent = 0;
  while (sent < 10000 && (*connection)->send(much)) ++sent;
  EXPECT_LT(sent, 10000);
  std::string text;
  EXPECT_EQ((*connection)->receive(text, monotonic_ns() + 1'000'000), Connection::Received::kLost);
  ended = true;
}

}  // namespace
}  // namespace palpate::haply
