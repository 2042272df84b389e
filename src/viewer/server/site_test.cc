#include "server/site.h"

#include <gtest/gtest.h>

#include "server/page.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::testing::FakeHost;

constexpr std::string_view kHost = "localhost:8480";

struct SiteTest : ::testing::Test {
  FakeHost host;
  Site site{host, Access("127.0.0.1", 8480, false, {}, {}), VolumeFacts{"00aa", 1, 0, {0, 1}, false}};

  static HttpRequest get(std::string_view target) {
    HttpRequest request;
    request.method = "GET";
    request.target = target;
    request.host = kHost;
    request.local_address = "127.0.0.1";
    return request;
  }
  int status_of(const HttpRequest& request) {
    const auto answer = site.answer(request);
    if (const auto* ready = std::get_if<HttpResponse>(&answer)) return ready->status;
    return std::holds_alternative<Upgrade>(answer) ? 101 : 200;
  }
  int status_of(std::string_view target) { return status_of(get(target)); }
};

TEST_F(SiteTest, ServesDocumentedPaths) {
  EXPECT_EQ(status_of("/"), 200);
  EXPECT_EQ(status_of("/assets/index.html"), 200);
  EXPECT_EQ(status_of("/api/scene"), 200);
  EXPECT_EQ(status_of("/api/volume/scan/00aa"), 200);
  EXPECT_EQ(status_of("/api/volume/labels/00aa?shrink=2"), 200);
  EXPECT_EQ(status_of("/api/volume/labels/00aa?shrink=4"), 200);
}

TEST_F(SiteTest, PicturesAreAskedForInOneWay) {
  const std::string view = "/api/picture/00aa?view=64,48,-10,-10,0,1,0,0,0,1,0";
  EXPECT_EQ(status_of(view), 200);
  EXPECT_EQ(status_of(view + ",22,14,-300"), 200);
  EXPECT_EQ(status_of(view + "&looks=ffeeddff0a0b0c00&cut=1,2,3,0,0,1"), 200);
  EXPECT_EQ(status_of("/api/picture/00ab?view=64,48,-10,-10,0,1,0,0,0,1,0"), 404);
  for (const char* more : {",22,14", ",22,14,300", "&looks=ffeeddff0", "&looks=ffeeddff0a0b0c000a0b0c00",
                           "&looks=ffeeddff0a0b0cxx", "&cut=1,2,3,0,0,0", "&cut=1,2,3",
                           "&view=64,48,-10,-10,0,1,0,0,0,1,0", "&other=1", ",nan,0,0", ",1e99,0,0"})
    EXPECT_EQ(status_of(view + more), 400) << more;
  for (const char* other :
       {"", "?", "?view=", "?view=64,48,0,0,0,0,0,0,0,1,0", "?view=64,48,0,0,0,1,0,0,1,0,0",
        "?view=64,48,0,0,0,1,0,0,0,2,0", "?view=8,48,0,0,0,1,0,0,0,1,0", "?view=64.5,48,0,0,0,1,0,0,0,1,0",
        "?view=2048,2048,0,0,0,1,0,0,0,1,0", "?looks=ffeeddff0a0b0c00"})
    EXPECT_EQ(status_of(std::string("/api/picture/00aa") + other), 400) << other;
}

TEST_F(SiteTest, NothingLeadsOutOfIt) {
  for (const char* target : {"/assets/",
                             "/assets/../index.html",
                             "/assets/..",
                             "/assets/%2e%2e/index.html",
                             "/assets/%2e%2e%2findex.html",
                             "/assets/..%5c..%5cetc%5cpasswd",
                             "/assets/..\\..\\etc\\passwd",
                             "/assets//etc/passwd",
                             "/../../etc/passwd",
                             "/%2e%2e/%2e%2e/etc/passwd",
                             "//etc/passwd",
                             "/etc/passwd",
                             "/index.html",
                             "/assets/index.html/",
                             "/api",
                             "/api/scene/",
                             "/API/SCENE",
                             "/api/volume/",
                             "/api/volume/scan",
                             "/api/volume/scan/",
                             "/api/volume/scan/00ab",
                             "/api/volume/scan/00aa/",
                             "/api/volume/scan/00aa?shrink=3",
                             "/api/volume/scan/00aa?shrink=2&x=1",
                             "/api/volume/scan/../scan/00aa",
                             "/api/volume/other/00aa",
                             "/favicon.ico",
                             "/wss",
                             "/ws/"})
    EXPECT_EQ(status_of(target), 404) << target;
  for (const char* target : {"", "*", "http://localhost:8480/", "etc/passwd", "?shrink=2"})
    EXPECT_EQ(status_of(target), 400) << target;
}

TEST_F(SiteTest, ValidatesTheOriginFirst) {
  HttpRequest request = get("/");
  request.host = "evil.example:8480";
  EXPECT_EQ(status_of(request), 421);
  request = get("/");
  request.origin = "http://evil.example";
  EXPECT_EQ(status_of(request), 403);
  request = get("/");
  request.ambiguous = true;
  EXPECT_EQ(status_of(request), 400);
  for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "CONNECT", "TRACE", "get", ""}) {
    request = get("/");
    request.method = method;
    EXPECT_EQ(status_of(request), 405) << method;
  }
  request = get("/");
  request.has_body = true;
  EXPECT_EQ(status_of(request), 413);
}

// another site's page can make a browser send requests, but gets no data
TEST_F(SiteTest, OtherSitesGetNoData) {
  for (const char* from : {"cross-site", "same-site"})
    for (const char* target : {"/api/scene", "/api/volume/scan/00aa", "/ws"}) {
      HttpRequest request = get(target);
      request.fetch_site = from;
      EXPECT_EQ(status_of(request), 403) << from << target;
    }
  HttpRequest link = get("/");
  link.fetch_site = "cross-site";
  EXPECT_EQ(status_of(link), 200);
}

TEST_F(SiteTest, TokensAreAskedForWhereThereIsData) {
  Site guarded(host, Access("127.0.0.1", 8480, false, {}, *Tokens::parse("view 0123456789abcdef", "t")),
               VolumeFacts{"00aa", 1, 0, {0, 1}, false});
  const auto status = [&](std::string_view target, std::string_view authorization) {
    HttpRequest request = get(target);
    request.authorization = authorization;
    const auto answer = guarded.answer(request);
    const auto* ready = std::get_if<HttpResponse>(&answer);
    return ready ? ready->status : 200;
  };
  EXPECT_EQ(status("/", ""), 200);
  EXPECT_EQ(status("/assets/index.html", ""), 200);
  for (const char* target : {"/api/scene", "/api/volume/scan/00aa", "/api/nothing"}) {
    EXPECT_EQ(status(target, ""), 401);
    EXPECT_EQ(status(target, "Bearer 0123456789abcdeX"), 401);
    EXPECT_NE(status(target, "Bearer 0123456789abcdef"), 401);
  }
  EXPECT_EQ(status("/api/scene?token=0123456789abcdef", ""), 401);
}

TEST_F(SiteTest, AWebSocketHasToBeAskedForAsOne) {
  HttpRequest request = get("/ws");
  EXPECT_EQ(status_of(request), 426);
  request.upgrade = true;
  EXPECT_EQ(status_of(request), 400);
  request.subprotocol = true;
  EXPECT_EQ(status_of(request), 101);
  request.origin = "http://localhost:8480";
  EXPECT_EQ(status_of(request), 101);
  request.origin = "http://evil.example";
  EXPECT_EQ(status_of(request), 403);
  request = get("/api/scene");
  request.upgrade = true;
  EXPECT_EQ(status_of(request), 200);
}

TEST_F(SiteTest, KnownVolumesAndFilesAreNotSentAgain) {
  HttpRequest request = get("/api/volume/labels/00aa?shrink=2");
  request.accept_encoding = "br, gzip;q=0.8";
  const auto requested = std::get<VolumeRequest>(site.answer(request));
  EXPECT_TRUE(requested.key.labels && requested.key.gzip && requested.key.shrink == 2);
  EXPECT_NE(requested.head.fields.find("Content-Encoding: gzip\r\n"), std::string::npos);
  EXPECT_NE(requested.head.fields.find("ETag: \"00aa-labels-2-gzip\"\r\n"), std::string::npos);
  EXPECT_NE(requested.head.fields.find("immutable"), std::string::npos);
  request.if_none_match = "\"other\", \"00aa-labels-2-gzip\"";
  EXPECT_EQ(status_of(request), 304);
  // the plain body has another ETag
  request.accept_encoding = "gzip;q=0, identity";
  EXPECT_EQ(status_of(request), 200);

  const auto page = std::get<HttpResponse>(site.answer(get("/")));
  const std::string tag = "\"" + std::string(viewer_page().front().sha256) + "\"";
  EXPECT_NE(page.fields.find("ETag: " + tag), std::string::npos);
  EXPECT_NE(page.fields.find("Cache-Control: no-cache"), std::string::npos);
  request = get("/");
  request.if_none_match = tag;
  EXPECT_EQ(status_of(request), 304);
}

TEST_F(SiteTest, ScansAreNotPacked) {
  HttpRequest request = get("/api/volume/scan/00aa");
  request.accept_encoding = "gzip";
  EXPECT_FALSE(std::get<VolumeRequest>(site.answer(request)).key.gzip);
  host.edit_scene().scan = nullptr;
  EXPECT_EQ(status_of(request), 404);
}

TEST_F(SiteTest, EveryAnswerIsGuarded) {
  for (const char* target : {"/", "/api/scene", "/nothing"}) {
    const HttpRequest request = get(target);
    const auto answer = std::get<HttpResponse>(site.answer(request));
    const std::string head = site.head_of(answer, request, true);
    EXPECT_TRUE(head.starts_with("HTTP/1.1 " + std::to_string(answer.status) + " "));
    EXPECT_NE(head.find("\r\nContent-Security-Policy: default-src 'none'; script-src 'self'; "),
              std::string::npos);
    // the page's worker is one of our files, and nothing else may be a worker
    EXPECT_NE(head.find("; worker-src 'self'; "), std::string::npos);
    EXPECT_NE(head.find("frame-ancestors 'none'\r\n"), std::string::npos);
    EXPECT_NE(head.find("\r\nX-Content-Type-Options: nosniff\r\n"), std::string::npos);
    EXPECT_NE(head.find("\r\nReferrer-Policy: no-referrer\r\n"), std::string::npos);
    EXPECT_NE(head.find("\r\nCross-Origin-Resource-Policy: same-origin\r\n"), std::string::npos);
    EXPECT_NE(head.find("\r\nContent-Length: " + std::to_string(answer.text().size()) + "\r\n"),
              std::string::npos);
    EXPECT_TRUE(head.ends_with("\r\n\r\n"));
    EXPECT_EQ(head.find("\r\n\r\n"), head.size() - 4);
  }
}

// an unknown Host is never echoed
TEST_F(SiteTest, RefusalsEchoNothing) {
  HttpRequest request = get("/DOE^CANARY");
  request.host = "canary.example";
  const auto answer = std::get<HttpResponse>(site.answer(request));
  const std::string all = site.head_of(answer, request, false) + std::string(answer.text());
  EXPECT_EQ(all.find("canary"), std::string::npos);
  EXPECT_EQ(all.find("CANARY"), std::string::npos);
}

}  // namespace
}  // namespace palpate::server
