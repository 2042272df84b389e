#include <gtest/gtest.h>

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "haply/connection.h"
#include "palpate/base/clock.h"

namespace palpate::haply {
namespace {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using tcp = asio::ip::tcp;
using std::chrono::milliseconds;

/// Accepts one connection and writes bytes onto it.
class RawService {
 public:
  RawService() : acceptor_(context_, tcp::endpoint(asio::ip::address_v4::loopback(), 0)) {}
  HaplySettings settings() const {
    HaplySettings settings;
    settings.port = acceptor_.local_endpoint().port();
    return settings;
  }
  /// Pieces, each after a pause; then what `then` does with the socket.
  template <class Then>
  void serve(std::vector<std::string> pieces, milliseconds pause, Then then) {
    thread_ = std::thread([this, pieces = std::move(pieces), pause, then] {
      websocket::stream<tcp::socket> stream(context_);
      acceptor_.accept(stream.next_layer());
      stream.accept();
      stream.next_layer().set_option(tcp::no_delay(true));
      for (const std::string& piece : pieces) {
        std::this_thread::sleep_for(pause);
        asio::write(stream.next_layer(), asio::buffer(piece));
      }
      then(stream);
    });
  }
  ~RawService() { thread_.join(); }

 private:
  asio::io_context context_;
  tcp::acceptor acceptor_;
  std::thread thread_;
};

/// A text's frame as a server sends it (RFC 6455, 5.2). @param fin  false: another part of the text follows
std::string frame(const std::string& text, int opcode = 1, bool fin = true) {
  std::string bytes(1, static_cast<char>((fin ? 0x80 : 0) | opcode));
  if (text.size() < 126) return bytes + static_cast<char>(text.size()) + text;
  return bytes + '\x7e' + static_cast<char>(text.size() >> 8) + static_cast<char>(text.size() & 0xff) + text;
}

/// What comes within two seconds, asked for again and again as the driver does. @param nothings  times that
/// there was none
Connection::Received next(Connection& connection, std::string& text, int& nothings) {
  const std::int64_t end_ns = monotonic_ns() + 2'000'000'000;
  while (monotonic_ns() < end_ns) {
    const auto received = connection.receive(text, monotonic_ns() + 1'000'000);
    if (received != Connection::Received::kNothing) return received;
    ++nothings;
  }
  return Connection::Received::kNothing;
}

// a message in pieces, with pauses longer than anybody waits: within its header, its length, its text and
// between its frames, and with the service's question in between
TEST(HaplyConnection, AMessageInPiecesComesWhole) {
  const std::string long_text(300, 'a'),
      all = frame(long_text) + frame("one", 1, false) + frame("?", 9) + frame("two", 0);
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
  service.serve(pieces, milliseconds(5), [&](auto& stream) {
    boost::beast::flat_buffer buffer;
    stream.control_callback([&](websocket::frame_type kind, boost::beast::string_view payload) {
      answered = kind == websocket::frame_type::pong && payload == "?";
    });
    stream.read(buffer);
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

// what came together is told one after another, though nothing more can be heard
TEST(HaplyConnection, TwoMessagesAtOnceAreTwo) {
  RawService service;
  service.serve({frame("first") + frame("second") + frame("third")}, milliseconds(0), [](auto& stream) {
    boost::beast::flat_buffer buffer;
    stream.read(buffer);
  });
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
    service.serve({frame("last")}, milliseconds(0), [&](auto& stream) {
      boost::system::error_code ignored;
      if (politely)
        asio::write(stream.next_layer(), asio::buffer(std::string("\x88\0", 2)), ignored);
      else
        stream.next_layer().close(ignored);
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

// a service that reads nothing more holds nobody up
TEST(HaplyConnection, SendingToWhoDoesNotReadEnds) {
  std::atomic<bool> ended{false};
  RawService service;
  service.serve({}, milliseconds(0), [&](auto&) {
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
