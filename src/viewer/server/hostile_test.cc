#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <chrono>
#include <fstream>
#include <memory>
#include <random>
#include <vector>

#include "base/test_folder.h"
#include "base/test_seed.h"
#include "palpate/base/clock.h"
#include "server/test_client.h"
#include "server/test_host.h"

// Malicious and malformed input: refused, logged without its content, and unnoticed by other viewers.
namespace palpate::server {
namespace {

using palpate::testing::Json;
using palpate::testing::kBinary;
using palpate::testing::kPing;
using palpate::testing::kText;
using palpate::testing::masked_frame;
using palpate::testing::number_at;
using palpate::testing::read_answer;
using palpate::testing::request;
using palpate::testing::soon;
using palpate::testing::TestServer;
using palpate::testing::TestSocket;
using palpate::testing::TestViewer;

constexpr const char* kCanary = "DOE^CANARY";

double resident_MB() {
  std::ifstream file("/proc/self/statm");
  double size = 0, resident = 0;
  file >> size >> resident;
  return resident * 4096 / 1e6;
}

/// Server with a bystanding viewer that must not be affected.
struct HostileTest : ::testing::Test {
  TestServer test;
  TestViewer bystander{test.port()};

  void SetUp() override {
    bystander.greet({{"poses_hz", 120}});
    bystander.text("state");
    sequence_ = number_at<std::uint64_t>(bystander.pose(), 8);
  }
  void TearDown() override {
    const std::string pose = bystander.pose();
    ASSERT_FALSE(pose.empty());
    EXPECT_GT(number_at<std::uint64_t>(pose, 8), sequence_);
    bystander.send({{"type", "set"}, {"id", 77}, {"paused", false}});
    EXPECT_EQ(bystander.text("done")["id"], 77);
    EXPECT_EQ(request(test.port(), "GET", "/").status, 200);
    EXPECT_EQ(test.log.text().find(kCanary), std::string::npos);
  }
  // The bystander drains its input, because a viewer that does not read is dropped.
  void keep_up() {
    constexpr std::int64_t kFresh_ns = 50'000'000;
    std::string pose = bystander.pose();
    while (!pose.empty() && number_at<std::int64_t>(pose, 32) < monotonic_ns() - kFresh_ns)
      pose = bystander.pose();
  }
  int status_of(const std::string& bytes) {
    TestSocket socket(test.port());
    socket.send(bytes);
    return read_answer(socket).status;
  }
  /// Close code that a welcomed viewer receives after sending `bytes`.
  int code_after(const std::string& bytes) {
    TestViewer viewer(test.port());
    viewer.greet();
    viewer.socket().send(bytes);
    return viewer.close_code();
  }

 private:
  std::uint64_t sequence_ = 0;
};

TEST_F(HostileTest, MalformedRequests) {
  const std::string host = "Host: " + test.host_name() + "\r\n";
  for (const std::string& bytes :
       {std::string("\r\n\r\n\r\n\r\n"), std::string("GET\r\n\r\n"), std::string("GET / HTTP/9.9\r\n\r\n"),
        "GET / HTTP/1.1\r\n" + host + "a b: c\r\n\r\n",
        "GET / HTTP/1.1\r\n" + host + "Content-Length: -1\r\n\r\n",
        "GET / HTTP/1.1\r\n" + host + "Content-Length: 99999999999999999999\r\n\r\n",
        "GET / HTTP/1.1\r\n" + host + host + "\r\n",
        std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11),
        "GET /" + std::string(kCanary) + "\x01 HTTP/1.1\r\n" + host + "\r\n"})
    EXPECT_EQ(status_of(bytes), 400) << bytes;
}

// RFC 9112, 5.2: a proxy in front of the server may parse a different header than the server
TEST_F(HostileTest, ObsoleteLineFolding) {
  const std::string host = "Host: " + test.host_name() + "\r\n";
  for (const std::string& head :
       {host + "X-Note: a\r\n b\r\n", host + "X-Note: a\r\n\tb\r\n", host + "X-Note: a\r\n \r\n",
        host + "X-Note:\r\n Content-Length: 5\r\n", "Host:\r\n " + test.host_name() + "\r\n",
        host + "Authorization: Bearer\r\n " + kCanary + "\r\n"}) {
    TestSocket socket(test.port());
    socket.send("GET / HTTP/1.1\r\n" + head + "\r\n");
    EXPECT_EQ(read_answer(socket).status, 400) << head;
    EXPECT_TRUE(socket.closes()) << head;
  }
  EXPECT_EQ(TestViewer(test.port(), "X-Note: a\r\n b\r\n").opening().status, 400);
  // white space within a line is no folding, and neither is it in the next head of the connection
  TestSocket socket(test.port());
  for (int n = 0; n < 2; ++n) {
    socket.send("GET / HTTP/1.1\r\n" + host + "X-Note: \t a  b\t\r\n\r\n");
    EXPECT_EQ(read_answer(socket).status, 200);
  }
}

TEST_F(HostileTest, ForeignHostsAndOrigins) {
  EXPECT_EQ(request(test.port(), "GET", "/", "Host: DOE^CANARY.example\r\n").status, 421);
  EXPECT_EQ(status_of("GET / HTTP/1.1\r\n\r\n"), 421);
  EXPECT_EQ(status_of("GET / HTTP/1.0\r\n\r\n"), 421);
  EXPECT_EQ(request(test.port(), "GET", "/api/scene", "Origin: http://DOE^CANARY.example\r\n").status, 403);
  EXPECT_EQ(request(test.port(), "GET", "/api/scene", "Origin: null\r\n").status, 403);
  EXPECT_EQ(TestViewer(test.port(), "Origin: http://evil.example\r\n").opening().status, 403);
  EXPECT_EQ(TestViewer(test.port(), "Origin: http://" + test.host_name() + "\r\n").opening().status, 101);
  EXPECT_NE(test.log.text().find("127.0.0.1: refused, 421"), std::string::npos);
}

TEST_F(HostileTest, PathsThatClimb) {
  for (const char* path :
       {"/assets/../../../../etc/passwd", "/..%2f..%2fetc%2fpasswd", "/assets/%2e%2e/index.html",
        "/assets/..\\index.html", "/DOE^CANARY", "//etc/passwd"})
    EXPECT_EQ(request(test.port(), "GET", path).status, 404) << path;
}

TEST_F(HostileTest, OtherMethodsAndBodies) {
  EXPECT_EQ(request(test.port(), "POST", "/api/scene").status, 405);
  EXPECT_EQ(request(test.port(), "DOE^CANARY", "/").status, 405);
  EXPECT_EQ(request(test.port(), "GET", "/", "Content-Length: 5\r\n").status, 413);
  // an answer arrives although the body does not end
  TestSocket socket(test.port());
  socket.send("GET / HTTP/1.1\r\nHost: " + test.host_name() + "\r\nContent-Length: 100000000\r\n\r\n" +
              std::string(100000, 'x'));
  EXPECT_EQ(read_answer(socket).status, 413);
  EXPECT_TRUE(socket.closes());
}

// requests whose end two programs could parse differently
TEST_F(HostileTest, BodiesThatCouldBeReadInTwoWays) {
  const std::string next = "GET /api/scene HTTP/1.1\r\nHost: " + test.host_name() + "\r\n\r\n";
  for (const char* fields :
       {"Transfer-Encoding: chunked\r\n", "Transfer-Encoding: identity\r\n",
        "Transfer-Encoding: xchunked\r\n", "Transfer-Encoding: gzip, chunked\r\n", "Transfer-Encoding:\r\n",
        "TRANSFER-ENCODING: Chunked\r\n", "Transfer-Encoding: gzip\r\nTransfer-Encoding: chunked\r\n",
        "Transfer-Encoding: chunked\r\nContent-Length: 4\r\n",
        "Content-Length: 4\r\nTransfer-Encoding: chunked\r\n", "Content-Length: 0\r\nContent-Length: 0\r\n",
        "Content-Length: 4\r\nContent-Length: 4\r\n", "Content-Length: 0\r\nContent-Length: 4\r\n",
        "Content-Length: 0, 0\r\n", "Content-Length: 0,4\r\n", "Content-Length: +0\r\n",
        "Content-Length: 0x0\r\n", "Content-Length:\r\n", "Transfer-Encoding : chunked\r\n",
        "Content-Length: 0\r\n Transfer-Encoding: chunked\r\n"}) {
    TestSocket socket(test.port());
    socket.send("GET / HTTP/1.1\r\nHost: " + test.host_name() + "\r\n" + fields + "\r\n0\r\n\r\n" + next);
    EXPECT_EQ(read_answer(socket).status, 400) << fields;
    // the following bytes are not treated as a request
    EXPECT_EQ(read_answer(socket).status, 0) << fields;
  }
  // a single Content-Length of 0 is an ordinary request
  EXPECT_EQ(request(test.port(), "GET", "/", "Content-Length: 0\r\n").status, 200);
}

TEST_F(HostileTest, GuessesOfTokens) {
  const palpate::test::TemporaryFolder folder;
  ViewerServerOptions options;
  options.token_file = palpate::test::write_private(folder / "tokens", "view a-token-of-our-own-71\n");
  TestServer guarded(options);
  TestViewer inside(guarded.port());
  ASSERT_EQ(inside.greet({{"token", "a-token-of-our-own-71"}})["type"], "welcome");
  const auto begun = std::chrono::steady_clock::now();
  int inspected = 0, left_out = 0;
  for (int n = 0; n < 60; ++n) {
    int status = 0;
    if (n % 2 == 0) {
      status = request(guarded.port(), "GET", "/api/scene", "Authorization: Bearer DOE^CANARY\r\n").status;
    } else {
      TestViewer guessing(guarded.port());
      guessing.send({{"type", "hello"}, {"protocol", 3}, {"token", "DOE^CANARY"}});
      status = guessing.close_code() - 4000;
    }
    ASSERT_TRUE(status == 401 || status == 429) << status;
    ++(status == 401 ? inspected : left_out);
  }
  // holds on a machine of any speed
  const double s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  EXPECT_LE(inspected, 5 + 5 * s + 1);
  EXPECT_EQ(guarded.log.text().find(kCanary), std::string::npos);
  // connected viewers stay connected, and after a short wait new ones are admitted
  EXPECT_FALSE(inside.pose().empty());
  EXPECT_TRUE(soon([&] {
    return request(guarded.port(), "GET", "/api/scene", "Authorization: Bearer a-token-of-our-own-71\r\n")
               .status == 200;
  }));
}

TEST_F(HostileTest, HeadsThatAreTooLong) {
  const std::string host = "Host: " + test.host_name() + "\r\n";
  const auto with_length = [&](std::size_t length) {
    const std::string head = "GET / HTTP/1.1\r\n" + host + "X: ";
    return head + std::string(length - head.size() - 4, 'x') + "\r\n\r\n";
  };
  EXPECT_EQ(status_of(with_length(8192)), 200);
  EXPECT_EQ(status_of(with_length(8193)), 431);
  EXPECT_EQ(status_of(with_length(1 << 20)), 431);
  EXPECT_EQ(status_of("GET /" + std::string(1 << 20, 'x')), 431);
}

TEST_F(HostileTest, AHeadThatComesByDribs) {
  TestSocket slow(test.port()), silent(test.port());
  const std::string head = "GET / HTTP/1.1\r\nHost: " + test.host_name() + "\r\n";
  int sent = 0;
  while (!slow.receive(100) && slow.send(head.substr(sent % head.size(), 1)) && sent < 600) ++sent;
  EXPECT_LT(sent, 600);
  EXPECT_TRUE(silent.closes());
  // an idle connection is no fault: browsers open them
  EXPECT_EQ(test.log.text(), "viewer 127.0.0.1: no request in time\n");
}

TEST_F(HostileTest, MalformedFrames) {
  // unmasked, reserved bit, unknown opcode, long control frame, fragmented control frame, continuation
  // without a start
  EXPECT_EQ(code_after("\x81\x02{}"), 1002);
  EXPECT_EQ(code_after(masked_frame(0xc1, "{}")), 1002);
  EXPECT_EQ(code_after(masked_frame(0x83, "{}")), 1002);
  EXPECT_EQ(code_after(masked_frame(kPing, std::string(126, 'x'))), 1002);
  EXPECT_EQ(code_after(masked_frame(0x09, "x")), 1002);
  EXPECT_EQ(code_after(masked_frame(0x80, "{}")), 1002);
  EXPECT_EQ(code_after(masked_frame(kText, "\xff\xfe")), 1007);
  EXPECT_EQ(code_after(masked_frame(kText, "DOE^CANARY")), 1007);
  EXPECT_EQ(code_after(masked_frame(kText, "")), 1007);
  EXPECT_EQ(code_after(masked_frame(kBinary, "{\"type\":\"rearm\",\"id\":1}")), 1003);
}

TEST_F(HostileTest, MessagesThatAreTooLong) {
  const double before_MB = resident_MB();
  EXPECT_EQ(code_after(masked_frame(kText, std::string(4097, ' '))), 1009);
  // announced lengths of a gigabyte, and beyond any file
  EXPECT_EQ(
      code_after(std::string("\x81\xff\0\0\0\0\x40\0\0\0\x11\x22\x33\x44", 14) + std::string(8000, 'x')),
      1009);
  EXPECT_EQ(code_after(std::string("\x81\xff\x7f\xff\xff\xff\xff\xff\xff\xff\x11\x22\x33\x44", 14)), 1009);
  // a gigabyte in short fragments
  TestViewer viewer(test.port());
  viewer.greet();
  viewer.socket().send(masked_frame(0x01, std::string(1000, ' ')));
  for (int n = 0; n < 1'000'000 && viewer.socket().send(masked_frame(0x00, std::string(1000, ' '))); ++n) {
  }
  EXPECT_LT(resident_MB() - before_MB, 50);
  const std::string longest = R"({"type":"set","id":5,"paused":false})";
  TestViewer fair(test.port());
  fair.greet();
  fair.socket().send(masked_frame(kText, longest + std::string(4096 - longest.size(), ' ')));
  EXPECT_EQ(fair.text("done")["id"], 5);
}

TEST_F(HostileTest, TooManyMessages) {
  std::string many;
  for (int n = 0; n < 1000; ++n) many += masked_frame(kText, R"({"type":"tip","patient_mm":[1,2,3]})");
  EXPECT_EQ(code_after(many), 1008);
  std::string pings;
  for (int n = 0; n < 1000; ++n) pings += masked_frame(kPing, "");
  EXPECT_EQ(code_after(pings), 1008);
}

TEST_F(HostileTest, MessagesOutOfTurn) {
  EXPECT_EQ(code_after(masked_frame(kText, R"({"type":"hello","protocol":3})")), 1008);
  TestViewer early(test.port());
  early.send({{"type", "stop"}, {"id", 1}});
  EXPECT_EQ(early.close_code(), 1008);
  EXPECT_FALSE(test.host.state().stop);
  TestViewer other(test.port());
  other.send({{"type", "hello"}, {"protocol", 1}});
  EXPECT_EQ(other.close_code(), 4406);
}

TEST_F(HostileTest, NoHello) {
  TestViewer silent(test.port());
  EXPECT_EQ(silent.close_code(), 4408);
}

TEST_F(HostileTest, NoSubprotocolOrNoKey) {
  const std::string upgrade =
      "GET /ws HTTP/1.1\r\nHost: " + test.host_name() +
      "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n";
  const std::string key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n",
                    ours = "Sec-WebSocket-Protocol: palpate.v1\r\n";
  EXPECT_EQ(status_of(upgrade + key + "\r\n"), 400);
  EXPECT_EQ(status_of(upgrade + ours + "\r\n"), 400);
  EXPECT_EQ(status_of(upgrade + key + "Sec-WebSocket-Protocol: other, palpate.v1\r\n\r\n"), 101);
  // frames before the upgrade is confirmed
  EXPECT_EQ(status_of(upgrade + key + ours + "\r\n" + masked_frame(kText, "{}")), 400);
}

// in upper case, with a comma, and several extensions
TEST_F(HostileTest, CompressionIsNeverAgreedUpon) {
  TestViewer viewer(test.port(), "Sec-WebSocket-Extensions: permessage-deflate; client_max_window_bits\r\n");
  EXPECT_EQ(viewer.opening().status, 101);
  EXPECT_EQ(viewer.opening().field("Sec-WebSocket-Extensions"), "");
  viewer.greet();
  viewer.socket().send(masked_frame(0xc1, "\x00"));
  EXPECT_EQ(viewer.close_code(), 1002);
}

TEST_F(HostileTest, AThousandConnections) {
  rlimit files{};
  ::getrlimit(RLIMIT_NOFILE, &files);
  files.rlim_cur = files.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &files);
  const double before_MB = resident_MB();
  {
    std::vector<std::unique_ptr<TestSocket>> sockets;
    for (int n = 0; n < 1000; ++n) sockets.push_back(std::make_unique<TestSocket>(test.port()));
    // others are served meanwhile
    EXPECT_EQ(request(test.port(), "GET", "/").status, 200);
    TestViewer viewer(test.port());
    EXPECT_EQ(viewer.greet()["type"], "welcome");
    EXPECT_FALSE(viewer.pose().empty());
    EXPECT_FALSE(bystander.pose().empty());
    EXPECT_LT(resident_MB() - before_MB, 100);
  }
  EXPECT_THAT(test.log.text(), ::testing::ContainsRegex("127\\.0\\.0\\.1.*too many connections"));
  EXPECT_LT(test.log.text().size(), 5000u);
}

// a stop is carried out, whatever ends the viewer that sent it
TEST_F(HostileTest, AStopStops) {
  const std::string stop = R"({"type": "stop", "id": 1})";
  std::string blanks = "{\"type\" :\n \"stop\"";
  blanks += std::string(4096 - blanks.size() - 1, ' ') + "}";
  for (const std::string& bytes :
       {masked_frame(kText, stop), masked_frame(kText, blanks), masked_frame(kBinary, stop),
        masked_frame(kText, R"({"type": "stop")"), masked_frame(kText, R"({"id": [[]], "type":"stop"})"),
        masked_frame(kText, R"({"id": null, "type": "stop", "type": "stop"})"),
        masked_frame(kText, "DOE^CANARY" + stop)}) {
    TestViewer viewer(test.port());
    viewer.greet();
    viewer.socket().send(bytes);
    EXPECT_TRUE(soon([&] { return test.host.state().stop.has_value(); })) << bytes;
    test.host.change([](ViewedState& state) { state.stop.reset(); });
  }
  // the part received before the connection was lost
  const std::string whole = masked_frame(kText, blanks);
  TestViewer lost(test.port());
  lost.greet();
  lost.socket().send(whole.substr(0, whole.size() - 100));
  lost.socket().end_sending();
  EXPECT_TRUE(soon([&] { return test.host.state().stop.has_value(); }));
  test.host.change([](ViewedState& state) { state.stop.reset(); });
  // a stop from a client without a token, and from one that sends something else
  TestViewer unknown(test.port());
  unknown.socket().send(masked_frame(kText, stop));
  EXPECT_EQ(unknown.close_code(), 1008);
  EXPECT_EQ(code_after(masked_frame(kText, R"({"type": "tip", "stop": "\"type\": \"stop\""})")), 1007);
  EXPECT_FALSE(test.host.state().stop);
}

// clients that neither send a hello nor close take up connections for a while, but too few to lock out
// others
TEST_F(HostileTest, ViewersThatNeverAnswer) {
  std::vector<std::unique_ptr<TestViewer>> silent;
  for (int n = 0; n < 300; ++n) silent.push_back(std::make_unique<TestViewer>(test.port()));
  EXPECT_EQ(request(test.port(), "GET", "/").status, 200);
  TestViewer viewer(test.port());
  EXPECT_EQ(viewer.greet()["type"], "welcome");
  EXPECT_FALSE(bystander.pose().empty());
}

TEST_F(HostileTest, DownloadsThatAreNotRead) {
  TestServer large({}, {256, 256, 80});
  const std::string requested =
      "GET /api/volume/scan/0f3a000000000001 HTTP/1.1\r\nHost: " + large.host_name() + "\r\n\r\n";
  std::vector<std::unique_ptr<TestSocket>> sockets;
  for (int n = 0; n < 260; ++n) {
    sockets.push_back(std::make_unique<TestSocket>(large.port(), false, 4096));
    sockets.back()->send(requested);
    ASSERT_NE(sockets.back()->take_until("\r\n\r\n").find("200 OK"), std::string::npos) << n;
    keep_up();
  }
  TestViewer viewer(large.port());
  EXPECT_EQ(viewer.greet()["type"], "welcome");
  EXPECT_EQ(request(large.port(), "GET", "/").status, 200);
  EXPECT_TRUE(sockets.front()->closes()) << "the first gives way";
  // the bystander keeps reading while the time limit of a non-reading viewer expires
  EXPECT_TRUE(soon([&] {
    keep_up();
    return large.log.text().find("receives its answer too slowly") != std::string::npos;
  }));
}

TEST_F(HostileTest, AnyBytes) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  for (int n = 0; n < 100; ++n) {
    std::string bytes(random() % 3000, '\0');
    for (char& byte : bytes) byte = static_cast<char>(random());
    if (n % 2 == 0) {
      TestSocket socket(test.port());
      socket.send(bytes);
    } else {
      TestViewer viewer(test.port());
      viewer.greet();
      viewer.socket().send(bytes);
    }
  }
  EXPECT_TRUE(soon([&] { return test.server->viewers() == 1; }));
}

TEST_F(HostileTest, DisconnectsMidRequest) {
  for (int n = 0; n < 50; ++n) {
    TestSocket socket(test.port());
    socket.send("GET /api/volume/scan/0f3a000000000001 HTTP/1.1\r\nHost: " + test.host_name() + "\r\n\r\n");
    TestViewer viewer(test.port());
    viewer.send({{"type", "hello"}, {"protocol", 3}});
    viewer.send({{"type", "pointer"}, {"id", 1}, {"take", true}});
  }
  EXPECT_TRUE(soon([&] { return test.server->viewers() == 1 && !test.host.pointer_claimed; }));
}

}  // namespace
}  // namespace palpate::server
