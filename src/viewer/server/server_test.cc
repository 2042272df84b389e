#include <gtest/gtest.h>
#include <sched.h>

#include <chrono>
#include <thread>

#include "base/test_folder.h"
#include "base/test_processors.h"
#include "server/page.h"
#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::test::TemporaryFolder;
using palpate::test::write_private;
using palpate::testing::FakeHost;
using palpate::testing::Json;
using palpate::testing::number_at;
using palpate::testing::read_answer;
using palpate::testing::request;
using palpate::testing::soon;
using palpate::testing::TestServer;
using palpate::testing::TestSocket;
using palpate::testing::TestViewer;

ErrorKind kind_of(const ViewerServerOptions& options, std::string* where = nullptr) {
  FakeHost host;
  const auto server = ViewerServer::start(host, options);
  EXPECT_FALSE(server.ok());
  if (server.ok()) return ErrorKind::kInterrupted;
  EXPECT_FALSE(server.error().what.empty() || server.error().remedy.empty());
  if (where) *where = server.error().where;
  return server.error().kind;
}

TEST(ViewerServer, ServesThePageAndTheScene) {
  TestServer test;
  EXPECT_EQ(test.server->url(), "http://" + test.host_name() + "/");
  const auto page = request(test.port(), "GET", "/");
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.field("Content-Type"), "text/html; charset=utf-8");
  EXPECT_NE(page.body.find("palpate"), std::string::npos);
  EXPECT_NE(page.field("Content-Security-Policy").find("connect-src 'self' ws://" + test.host_name() + ";"),
            std::string::npos);
  EXPECT_EQ(request(test.port(), "GET", "/", "If-None-Match: " + page.field("ETag") + "\r\n").status, 304);

  const auto scene = request(test.port(), "GET", "/api/scene");
  EXPECT_EQ(scene.status, 200);
  EXPECT_EQ(scene.field("Cache-Control"), "no-store");
  const Json json = Json::parse(scene.body);
  EXPECT_EQ(json["role"], "control");
  EXPECT_EQ(json["volume"]["hash"], "0f3a000000000001");
}

TEST(ViewerServer, ServesVolumes) {
  TestServer test;
  const std::string scan = "/api/volume/scan/0f3a000000000001",
                    labels = "/api/volume/labels/0f3a000000000001";
  const auto whole = request(test.port(), "GET", scan);
  EXPECT_EQ(whole.status, 200);
  ASSERT_EQ(whole.body.size(), 2u * 5 * 4 * 3);
  for (int v = 0; v < 60; ++v)
    EXPECT_EQ(number_at<std::int16_t>(whole.body, 2 * static_cast<std::size_t>(v)), v - 1000);
  const auto head = request(test.port(), "HEAD", scan);
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.field("Content-Length"), "120");
  EXPECT_EQ(request(test.port(), "GET", scan + "?shrink=2").body.size(), 2u * 3 * 2 * 2);
  EXPECT_EQ(request(test.port(), "GET", scan, "If-None-Match: " + whole.field("ETag") + "\r\n").status, 304);

  const auto plain = request(test.port(), "GET", labels);
  EXPECT_EQ(plain.body.size(), 60u);
  EXPECT_EQ(plain.field("Content-Encoding"), "");
  EXPECT_EQ(plain.body[7], 1);
  const auto packed = request(test.port(), "GET", labels, "Accept-Encoding: gzip\r\n");
  EXPECT_EQ(packed.field("Content-Encoding"), "gzip");
  EXPECT_EQ(packed.body.substr(0, 2), "\x1f\x8b");
  EXPECT_NE(packed.field("ETag"), plain.field("ETag"));
}

// HEAD has no body, so that the next answer on the connection is parsed correctly
TEST(ViewerServer, AnswersOneRequestAfterTheOther) {
  TestServer test;
  TestSocket socket(test.port());
  const std::string host = "Host: " + test.host_name() + "\r\n\r\n";
  // pipelined
  socket.send("HEAD / HTTP/1.1\r\n" + host + "GET /api/volume/scan/0f3a000000000001 HTTP/1.1\r\n" + host +
              "GET /api/scene HTTP/1.1\r\n" + host);
  EXPECT_EQ(read_answer(socket, true).status, 200);
  EXPECT_EQ(read_answer(socket).body.size(), 120u);
  EXPECT_EQ(Json::parse(read_answer(socket).body)["protocol"], 3);
  socket.send("GET / HTTP/1.1\r\nConnection: close\r\n" + host);
  EXPECT_EQ(read_answer(socket).field("Connection"), "close");
  EXPECT_TRUE(socket.closes());
}

// a large volume is generated and sent while other viewers get their poses
TEST(ViewerServer, LargeVolumesDelayNoOtherViewer) {
  TestServer test({}, {256, 256, 160});
  TestViewer viewer(test.port());
  viewer.greet({{"poses_hz", 120}});
  std::thread reader([&] {
    const auto answer =
        request(test.port(), "GET", "/api/volume/labels/0f3a000000000001", "Accept-Encoding: gzip\r\n");
    EXPECT_EQ(answer.status, 200);
    const auto scan = request(test.port(), "GET", "/api/volume/scan/0f3a000000000001");
    EXPECT_EQ(scan.body.size(), std::size_t{2} * 256 * 256 * 160);
  });
  std::uint64_t last = number_at<std::uint64_t>(viewer.pose(), 8);
  for (int n = 0; n < 60; ++n) {
    const std::string pose = viewer.pose();
    ASSERT_FALSE(pose.empty());
    EXPECT_GT(number_at<std::uint64_t>(pose, 8), last);
    last = number_at<std::uint64_t>(pose, 8);
  }
  reader.join();
}

TEST(ViewerServer, OptionsThatDoNotGoTogether) {
  std::string where;
  ViewerServerOptions options;
  options.address = "0.0.0.0";
  EXPECT_EQ(kind_of(options, &where), ErrorKind::kUsage);
  EXPECT_EQ(where, "--listen 0.0.0.0");
  options.address = "localhost";
  EXPECT_EQ(kind_of(options), ErrorKind::kUsage);
  options = {};
  options.port = 65536;
  EXPECT_EQ(kind_of(options), ErrorKind::kUsage);
  options = {};
  options.tls_certificate = "some.pem";
  EXPECT_EQ(kind_of(options), ErrorKind::kUsage);
  options.tls_key = "some.key";
  EXPECT_EQ(kind_of(options), ErrorKind::kBadInput);
  options = {};
  options.token_file = "/nowhere/tokens";
  EXPECT_EQ(kind_of(options), ErrorKind::kBadInput);
  // documentation address that no machine has
  const TemporaryFolder folder;
  options.token_file = write_private(folder / "tokens", "view 0123456789abcdef\n");
  options.address = "192.0.2.1";
  EXPECT_EQ(kind_of(options), ErrorKind::kUnavailable);
}

// 0.0.0.0 is not an address that a browser can open
TEST(ViewerServer, ListeningEverywhereItTellsAnAddress) {
  const TemporaryFolder folder;
  ViewerServerOptions options;
  options.token_file = write_private(folder / "tokens", "view 0123456789abcdef\n");
  for (const char* all : {"0.0.0.0", "::"}) {
    options.address = all;
    FakeHost host;
    options.port = 0;
    const auto server = ViewerServer::start(host, options);
    // the machine may lack IPv6
    if (!server && std::string(all) == "::") continue;
    ASSERT_TRUE(server.ok());
    const std::string url = (*server)->url();
    EXPECT_EQ(url.find("//0.0.0.0"), url.npos) << url;
    EXPECT_EQ(url.find("//[::]"), url.npos) << url;
    EXPECT_NE(url.find(":" + std::to_string((*server)->port()) + "/"), url.npos) << url;
    EXPECT_EQ(request((*server)->port(), "GET", "/").status, 200);
  }
}

TEST(ViewerServer, ReportsThreadCreationFailure) {
  const palpate::test::NoThreads none;
  ViewerServerOptions options;
  options.port = 0;
  EXPECT_EQ(kind_of(options), ErrorKind::kUnavailable);
}

TEST(ViewerServer, TwoOnOnePortIsAnError) {
  TestServer first;
  ViewerServerOptions options;
  options.port = first.port();
  std::string where;
  EXPECT_EQ(kind_of(options, &where), ErrorKind::kUnavailable);
  EXPECT_EQ(where, first.host_name());
  // a server may follow another on the same port
  const int port = first.port();
  TestViewer viewer(port);
  viewer.greet();
  first.server.reset();
  options.port = port;
  EXPECT_TRUE(ViewerServer::start(first.host, options).ok());
}

TEST(ViewerServer, EndsWithViewersOfEveryKindConnected) {
  TestServer test({}, {256, 256, 64});
  TestViewer greeted(test.port()), silent(test.port());
  greeted.greet();
  // these read nothing, send half a request, wait for a volume that is being generated
  TestViewer stuck(test.port(), "", false, 4096);
  stuck.greet({{"poses_hz", 120}});
  TestSocket half(test.port()), wants(test.port());
  half.send("GET / HT");
  wants.send("GET /api/volume/labels/0f3a000000000001 HTTP/1.1\r\nAccept-Encoding: gzip\r\nHost: " +
             test.host_name() + "\r\n\r\n");
  ASSERT_TRUE(soon([&] { return test.server->viewers() == 2; }));
  test.server.reset();
  EXPECT_EQ(greeted.close_code(), 1001);
  EXPECT_EQ(silent.close_code(), 1001);
  EXPECT_TRUE(half.closes());
  EXPECT_TRUE(wants.closes());
}

// in every phase of a viewer's connection
TEST(ViewerServer, EndsWhileViewersComeIn) {
  for (int n = 0; n < 40; ++n) {
    TestServer test;
    TestSocket first(test.port()), second(test.port());
    for (TestSocket* socket : {&first, &second})
      socket->send(
          "GET /ws HTTP/1.1\r\nHost: " + test.host_name() +
          "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
          "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: palpate.v1\r\n\r\n");
    std::this_thread::sleep_for(std::chrono::microseconds(20 * n));
    test.server.reset();
    EXPECT_TRUE(first.closes());
    EXPECT_TRUE(second.closes());
  }
}

// regardless of the starting thread: here one whose scheduling class would be inherited
TEST(ViewerServer, ItsThreadsAreOrdinary) {
  std::atomic<int> policy{-1};
  class Host : public FakeHost {
   public:
    explicit Host(std::atomic<int>& observed) : observed_(observed) {}
    ViewedState state() const override {
      observed_ = ::sched_getscheduler(0);
      return FakeHost::state();
    }

   private:
    std::atomic<int>& observed_;
  } host(policy);
  std::unique_ptr<ViewerServer> server;
  std::thread([&] {
    sched_param batch{};
    ASSERT_EQ(::pthread_setschedparam(::pthread_self(), SCHED_BATCH, &batch), 0);
    ViewerServerOptions options;
    options.port = 0;
    server = *ViewerServer::start(host, options);
  }).join();
  EXPECT_EQ(request(server->port(), "GET", "/api/scene").status, 200);
  EXPECT_EQ(policy, SCHED_OTHER);
}

}  // namespace
}  // namespace palpate::server
