#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rsa.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <sys/stat.h>

#include <array>
#include <filesystem>
#include <memory>
#include <utility>

#include "base/test_folder.h"
#include "server/test_client.h"
#include "server/test_host.h"
#include "server/transport.h"

namespace palpate::server {
namespace {

using palpate::test::TemporaryFolder;
using palpate::test::write_text;
using palpate::testing::Json;
using palpate::testing::number_at;
using palpate::testing::read_answer;
using palpate::testing::request;
using palpate::testing::TestServer;
using palpate::testing::TestSocket;
using palpate::testing::TestViewer;

struct Pem {
  std::string certificate, key;
};

std::string text_of(BIO* bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(bio, &data);
  std::string text(data, static_cast<std::size_t>(size));
  BIO_free(bio);
  return text;
}

// key with a self-signed certificate
Pem self_signed(bool rsa = false) {
  const std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)> key(rsa ? EVP_RSA_gen(2048) : EVP_EC_gen("P-256"),
                                                                &EVP_PKEY_free);
  const std::unique_ptr<X509, decltype(&X509_free)> certificate(X509_new(), &X509_free);
  X509_set_version(certificate.get(), 2);
  ASN1_INTEGER_set(X509_get_serialNumber(certificate.get()), 1);
  X509_gmtime_adj(X509_getm_notBefore(certificate.get()), 0);
  X509_gmtime_adj(X509_getm_notAfter(certificate.get()), 3600);
  X509_set_pubkey(certificate.get(), key.get());
  X509_NAME* name = X509_get_subject_name(certificate.get());
  X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char*>("localhost"),
                             -1, -1, 0);
  X509_set_issuer_name(certificate.get(), name);
  X509_sign(certificate.get(), key.get(), EVP_sha256());
  BIO* certificate_text = BIO_new(BIO_s_mem());
  PEM_write_bio_X509(certificate_text, certificate.get());
  BIO* key_text = BIO_new(BIO_s_mem());
  PEM_write_bio_PrivateKey(key_text, key.get(), nullptr, nullptr, 0, nullptr, nullptr);
  return {text_of(certificate_text), text_of(key_text)};
}

struct TlsTest : ::testing::Test {
  TemporaryFolder folder;
  ViewerServerOptions options;

  void SetUp() override {
    const Pem pem = self_signed();
    options.tls_certificate = write_text(folder / "certificate.pem", pem.certificate);
    options.tls_key = write_key(pem);
  }
  std::filesystem::path write_key(const Pem& pem, const char* name = "key.pem") {
    const auto file = write_text(folder / name, pem.key);
    ::chmod(file.c_str(), 0600);
    return file;
  }
};

TEST_F(TlsTest, EncryptsAllTraffic) {
  TestServer test(options, {64, 64, 64});
  EXPECT_EQ(test.server->url(), "https://" + test.host_name() + "/");
  const auto page = request(test.port(), "GET", "/", "", true);
  EXPECT_EQ(page.status, 200);
  EXPECT_NE(page.field("Content-Security-Policy").find(" wss://" + test.host_name() + ";"),
            std::string::npos);
  EXPECT_EQ(request(test.port(), "GET", "/api/volume/scan/0f3a000000000001", "", true).body.size(),
            2u * 64 * 64 * 64);
  TestViewer viewer(test.port(), "Origin: https://" + test.host_name() + "\r\n", true);
  EXPECT_EQ(viewer.greet()["type"], "welcome");
  std::uint64_t sequence = 0;
  for (int n = 0; n < 10; ++n) {
    const std::string pose = viewer.pose();
    ASSERT_FALSE(pose.empty());
    EXPECT_GT(number_at<std::uint64_t>(pose, 8), sequence);
    sequence = number_at<std::uint64_t>(pose, 8);
  }
  viewer.send({{"type", "set"}, {"id", 1}, {"paused", true}});
  EXPECT_EQ(viewer.text("done")["id"], 1);
  // a page with an http origin is not the server's own
  EXPECT_EQ(TestViewer(test.port(), "Origin: http://" + test.host_name() + "\r\n", true).opening().status,
            403);
}

TEST_F(TlsTest, RefusesPlainConnections) {
  TestServer test(options);
  EXPECT_EQ(request(test.port(), "GET", "/").status, 0);
  TestSocket silent(test.port());
  EXPECT_TRUE(silent.closes());
  EXPECT_NE(test.log.text().find("no TLS"), std::string::npos);
}

/// TLS client with selectable version and ciphers.
struct OfferingClient {
  OfferingClient(int port, int version, const std::string& ciphers) {
    handle = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    PALPATE_CHECK(::connect(handle, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0);
    // includes what current libraries no longer offer by default
    SSL_CTX_set_security_level(context, 0);
    SSL_CTX_set_min_proto_version(context, version);
    SSL_CTX_set_max_proto_version(context, version);
    PALPATE_CHECK(version == TLS1_3_VERSION ? SSL_CTX_set_ciphersuites(context, ciphers.c_str()) == 1
                                            : SSL_CTX_set_cipher_list(context, ciphers.c_str()) == 1);
    tls = SSL_new(context);
    SSL_set_fd(tls, handle);
    agreed = SSL_connect(tls) == 1;
  }
  ~OfferingClient() {
    SSL_free(tls);
    SSL_CTX_free(context);
    ::close(handle);
  }
  OfferingClient(const OfferingClient&) = delete;
  OfferingClient& operator=(const OfferingClient&) = delete;

  int handle = -1;
  SSL_CTX* context = SSL_CTX_new(TLS_client_method());
  SSL* tls = nullptr;
  bool agreed = false;
};

TEST_F(TlsTest, RefusesWorldReadableKeys) {
  for (const auto& [mode, refused] :
       {std::pair{0600, false}, {0640, false}, {0644, true}, {0604, true}, {0602, true}}) {
    ASSERT_EQ(::chmod(options.tls_key.c_str(), static_cast<mode_t>(mode)), 0);
    const auto read = TlsIdentity::read(options.tls_certificate, options.tls_key);
    EXPECT_EQ(!read.ok(), refused) << mode;
    if (refused) {
      EXPECT_THAT(read.error().message(), ::testing::HasSubstr("chmod 600"));
    }
  }
}

TEST_F(TlsTest, OnlyForwardSecretCiphers) {
  for (const bool rsa : {false, true}) {
    const Pem pem = self_signed(rsa);
    write_text(folder / "certificate.pem", pem.certificate);
    write_key(pem);
    TestServer test(options);
    const auto agrees = [&](int version, const std::string& ciphers) {
      return OfferingClient(test.port(), version, ciphers).agreed;
    };
    const std::string own = rsa ? "ECDHE-RSA-" : "ECDHE-ECDSA-";
    for (const char* cipher : {"AES128-GCM-SHA256", "AES256-GCM-SHA384", "CHACHA20-POLY1305"})
      EXPECT_TRUE(agrees(TLS1_2_VERSION, own + cipher)) << own << cipher;
    for (const char* cipher :
         {"TLS_AES_128_GCM_SHA256", "TLS_AES_256_GCM_SHA384", "TLS_CHACHA20_POLY1305_SHA256"})
      EXPECT_TRUE(agrees(TLS1_3_VERSION, cipher)) << cipher;
    // ciphers without authenticated encryption, ephemeral keys or a certificate, truncated or obsolete
    for (const std::string& cipher :
         {own + "AES128-SHA256", own + "AES256-SHA384", own + "AES128-SHA", std::string("AES128-GCM-SHA256"),
          std::string("AES256-SHA256"), std::string("AES128-SHA"), std::string("DHE-RSA-AES128-GCM-SHA256"),
          std::string("AECDH-AES128-SHA"), std::string("AES128-CCM8")})
      EXPECT_FALSE(agrees(TLS1_2_VERSION, cipher)) << cipher;
    EXPECT_FALSE(agrees(TLS1_3_VERSION, "TLS_AES_128_CCM_8_SHA256"));
    EXPECT_FALSE(agrees(TLS1_1_VERSION, "ALL"));
    EXPECT_FALSE(agrees(TLS1_VERSION, "ALL"));
  }
}

TEST_F(TlsTest, DisablesCompressionAndResumption) {
  TestServer test(options);
  OfferingClient client(test.port(), TLS1_2_VERSION, "ECDHE+AESGCM");
  ASSERT_TRUE(client.agreed);
  EXPECT_EQ(SSL_get_current_compression(client.tls), nullptr);
  // no session ID that would allow a resumption
  const SSL_SESSION* const session = SSL_get0_session(client.tls);
  unsigned id_bytes = 0;
  SSL_SESSION_get_id(session, &id_bytes);
  EXPECT_EQ(id_bytes, 0u);
  EXPECT_FALSE(SSL_SESSION_has_ticket(session));
}

// a TLS 1.3 session ticket would arrive after the handshake, with the next read
TEST_F(TlsTest, NoSessionIsOffered) {
  TestServer test(options);
  OfferingClient client(test.port(), TLS1_3_VERSION, "TLS_AES_128_GCM_SHA256");
  ASSERT_TRUE(client.agreed);
  const std::string requested =
      "GET / HTTP/1.1\r\nHost: localhost:" + std::to_string(test.port()) + "\r\n\r\n";
  ASSERT_EQ(SSL_write(client.tls, requested.data(), static_cast<int>(requested.size())),
            static_cast<int>(requested.size()));
  std::array<char, 64> answer{};
  ASSERT_GT(SSL_read(client.tls, answer.data(), static_cast<int>(answer.size())), 0);
  EXPECT_FALSE(SSL_SESSION_is_resumable(SSL_get0_session(client.tls)));
}

TEST_F(TlsTest, RefusesRenegotiation) {
  TestServer test(options);
  OfferingClient client(test.port(), TLS1_2_VERSION, "ECDHE+AESGCM");
  ASSERT_TRUE(client.agreed);
  ASSERT_EQ(SSL_renegotiate(client.tls), 1);
  EXPECT_NE(SSL_do_handshake(client.tls), 1);
}

TEST_F(TlsTest, EndsWithViewersConnected) {
  TestServer test(options);
  TestViewer viewer(test.port(), "", true);
  viewer.greet();
  test.server.reset();
  EXPECT_EQ(viewer.close_code(), 1001);
}

TEST_F(TlsTest, RefusesAMismatchedKey) {
  options.tls_key = write_key(self_signed(), "other.pem");
  palpate::testing::FakeHost host;
  const auto server = ViewerServer::start(host, options);
  ASSERT_FALSE(server.ok());
  EXPECT_EQ(server.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(server.error().where, (folder / "other.pem").string());
}

}  // namespace
}  // namespace palpate::server
