#include <openssl/ssl.h>
#include <pthread.h>

#include <atomic>
#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/v6_only.hpp>
#include <exception>
#include <system_error>
#include <thread>
#include <utility>

#include "link/connection.h"
#include "link/hub.h"
#include "link/ordinary_thread.h"
#include "link/reachable.h"
#include "link/stream.h"
#include "palpate/base/file.h"
#include "palpate/link/viewer_server.h"

namespace palpate {
namespace link {
namespace {

using net::ip::tcp;

constexpr auto kAcceptAgain = std::chrono::milliseconds(100);
constexpr int kMostPort = 65535;
// ephemeral keys and authenticated encryption alone
constexpr const char *kCiphers12 = "ECDHE+AESGCM:ECDHE+CHACHA20:!aNULL",
                     *kCiphers13 =
                         "TLS_AES_256_GCM_SHA384:TLS_CHACHA20_POLY1305_SHA256:TLS_AES_128_GCM_SHA256";

Error usage(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kUsage, std::move(what), std::move(where), std::move(remedy)};
}

Result<net::ip::address> checked_address(const ViewerServerOptions& options) {
  ErrorCode failed;
  const auto address = net::ip::make_address(options.address, failed);
  if (failed)
    return usage("is no numeric address", "--listen " + options.address,
                 "give one of this machine's, 0.0.0.0 or [::] without its brackets for all of them");
  if (options.port < 0 || options.port > kMostPort)
    return usage("is no port", "--port " + std::to_string(options.port), "give a number from 1 to 65535");
  if (options.tls_certificate.empty() != options.tls_key.empty())
    return usage("a certificate and its key go together",
                 options.tls_key.empty() ? "--tls-cert" : "--tls-key", "give both --tls-cert and --tls-key");
  if (!address.is_loopback() && options.token_file.empty())
    return usage("whoever reaches this address could see and change the session",
                 "--listen " + options.address, "give --token-file FILE, or listen at 127.0.0.1 alone");
  return address;
}

Error bad_tls(const std::filesystem::path& file, const char* what) {
  return {ErrorKind::kBadInput, what, file.string(),
          "give PEM files that belong together and that you may read"};
}

Result<std::unique_ptr<net::ssl::context>> tls_context(const ViewerServerOptions& options) {
  if (options.tls_certificate.empty()) return std::unique_ptr<net::ssl::context>();
  auto tls = std::make_unique<net::ssl::context>(net::ssl::context::tls_server);
  // keys are gone when the connection is: whoever learns the certificate's key later reads nothing of it
  SSL_CTX* const context = tls->native_handle();
  PALPATE_CHECK(SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION) == 1 &&
                SSL_CTX_set_cipher_list(context, kCiphers12) == 1 &&
                SSL_CTX_set_ciphersuites(context, kCiphers13) == 1);
  SSL_CTX_set_options(context, SSL_OP_NO_COMPRESSION | SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_TICKET);
  SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
  ErrorCode failed;
  // a key with a passphrase must not ask for it at the terminal
  tls->set_password_callback([](std::size_t, net::ssl::context::password_purpose) { return std::string(); },
                             failed);
  constexpr std::size_t kMostPemBytes = std::size_t{1} << 20;
  const auto certificate = read_file(options.tls_certificate, kMostPemBytes);
  if (!certificate) return certificate.error();
  tls->use_certificate_chain(net::buffer(*certificate), failed);
  if (failed) return bad_tls(options.tls_certificate, "holds no certificate that can be read");
  const auto key = read_file(options.tls_key, kMostPemBytes);
  if (!key) return key.error();
  tls->use_private_key(net::buffer(*key), net::ssl::context::pem, failed);
  if (failed) return bad_tls(options.tls_key, "holds no key of that certificate that can be read");
  return tls;
}

class Server : public ViewerServer {
 public:
  /// The socket is bound and listens before anything is made that costs time.
  Server(ViewerHost& host, const ViewerServerOptions& options, std::unique_ptr<net::ssl::context> tls,
         Tokens tokens, const net::ip::address& address, ErrorCode& failed)
      : tls_(std::move(tls)), acceptor_(context_), accept_again_(context_) {
    listen({address, static_cast<std::uint16_t>(options.port)}, failed);
    if (failed) return;
    const ViewedScene& scene = host.scene();
    PALPATE_CHECK(scene.labels &&
                  (!scene.scan || scene.scan->geometry().dims == scene.labels->geometry().dims));
    const ScanScale scale = scene.scan ? ScanScale::of(*scene.scan) : ScanScale{};
    const VolumeFacts facts{hash_text(scene.content_hash), scale.scale, scale.offset, scale.range,
                            needs_wide_labels(*scene.labels)};
    Access access(address.to_string(), port(), tls_ != nullptr, options.host_names, std::move(tokens));
    if (access.has_learners() && has_quiz(scene)) veil_.emplace(scene);
    volumes_.emplace(volume_maker(scene.scan, scale, scene.labels, facts.wide_labels,
                                  veil_ ? veil_->scene().labels : nullptr));
    pictures_.emplace(host);
    site_.emplace(host, std::move(access), facts, veil_ ? &*veil_ : nullptr);
    // what a page loads: the scan and the labels
    const std::size_t voxel_bytes = (scene.scan ? 2 : 0) + (facts.wide_labels ? 2 : 1);
    const DownloadPace downloads(scene.labels->geometry().voxel_count() * voxel_bytes,
                                 DownloadPace::Clock::now());
    hub_.emplace(context_, host, *site_, *volumes_, *pictures_, downloads, FaultLog(options.log),
                 [this](int viewers) { viewers_ = viewers; });
    hub_->begin();
    accept();
    thread_ = std::thread([this] { run(); });
  }

  ~Server() override {
    if (!thread_.joinable()) return;
    net::post(context_, [this] {
      acceptor_.close();
      hub_->end();
    });
    thread_.join();
    // their threads may still hand something to the context
    volumes_.reset();
    pictures_.reset();
  }

  std::string url() const override {
    const std::string host = address_.is_v6() ? "[" + address_.to_string() + "]" : address_.to_string();
    return (tls_ ? "https://" : "http://") + host + ":" + std::to_string(port_) + "/";
  }
  int port() const override { return port_; }
  int viewers() const override { return viewers_; }

 private:
  void listen(const tcp::endpoint& endpoint, ErrorCode& failed) {
    acceptor_.open(endpoint.protocol(), failed);
    // a server that has just ended may be followed by another
    if (!failed) acceptor_.set_option(net::socket_base::reuse_address(true), failed);
    if (!failed) acceptor_.bind(endpoint, failed);
    if (!failed) acceptor_.listen(net::socket_base::max_listen_connections, failed);
    const auto bound = failed ? endpoint : acceptor_.local_endpoint(failed);
    net::ip::v6_only v6_only(false);
    if (!failed && bound.address().is_v6()) acceptor_.get_option(v6_only, failed);
    address_ = reachable_address(bound.address(), own_addresses(), v6_only.value());
    port_ = bound.port();
  }

  void accept() {
    acceptor_.async_accept([this](ErrorCode failed, Stream::Socket socket) {
      if (!acceptor_.is_open()) return;
      if (failed) {
        // out of file descriptors, most likely: trying at once would spin
        accept_again_.expires_after(kAcceptAgain);
        accept_again_.async_wait([this](ErrorCode cancelled) {
          if (!cancelled && acceptor_.is_open()) accept();
        });
        return;
      }
      // whatever becomes of this one, others may come
      accept();
      take(std::move(socket));
    });
  }

  void take(Stream::Socket socket) {
    hub_->make_room_for_connection();
    const auto connection =
        std::make_shared<Connection>(std::make_unique<Stream>(std::move(socket), tls_.get()), *hub_);
    hub_->add(connection);
    connection->begin();
  }

  void run() {
    be_ordinary_thread("viewers");
    // what one connection's handler throws (no memory) ends that handler and nobody else's
    while (!context_.stopped()) try {
        context_.run();
      } catch (const std::exception&) {
        hub_->log().say("", "a fault in the server");
      }
  }

  net::io_context context_{1};
  std::unique_ptr<net::ssl::context> tls_;
  net::basic_socket_acceptor<tcp, net::io_context::executor_type> acceptor_;
  net::steady_timer accept_again_;
  net::ip::address address_;  // that others are told
  int port_ = 0;
  std::atomic<int> viewers_{0};
  std::optional<Veil> veil_;
  std::optional<PayloadStore> volumes_;
  std::optional<PictureStore> pictures_;
  std::optional<Site> site_;
  std::optional<Hub> hub_;
  std::thread thread_;
};

// what options name, read
struct Admission {
  net::ip::address address;
  Tokens tokens;
  std::unique_ptr<net::ssl::context> tls;
};

Result<Admission> admission(const ViewerServerOptions& options) {
  const auto address = checked_address(options);
  if (!address) return address.error();
  Admission read{*address, {}, nullptr};
  if (!options.token_file.empty()) {
    auto tokens = Tokens::read(options.token_file, options.log);
    if (!tokens) return tokens.error();
    read.tokens = *std::move(tokens);
  }
  auto tls = tls_context(options);
  if (!tls) return tls.error();
  read.tls = *std::move(tls);
  return read;
}

}  // namespace
}  // namespace link

Result<void> ViewerServer::check(ViewerServerOptions options) {
  options.log = {};
  const auto read = link::admission(options);
  if (!read) return read.error();
  return {};
}

Result<std::unique_ptr<ViewerServer>> ViewerServer::start(ViewerHost& host,
                                                          const ViewerServerOptions& options) try {
  auto read = link::admission(options);
  if (!read) return read.error();
  if (!read->address.is_loopback() && options.tls_certificate.empty() && options.log)
    options.log(
        "viewers: tokens and data cross the network in the clear; --tls-cert and --tls-key encrypt them");

  link::ErrorCode failed;
  auto server = std::make_unique<link::Server>(host, options, std::move(read->tls), std::move(read->tokens),
                                               read->address, failed);
  if (failed)
    return Error{ErrorKind::kUnavailable, "cannot be listened at: " + failed.message(),
                 options.address + ":" + std::to_string(options.port),
                 "choose another --port, or end the program that has this one"};
  return std::unique_ptr<ViewerServer>(std::move(server));
} catch (const std::system_error& error) {
  return Error{ErrorKind::kUnavailable, std::string("no thread for the viewers: ") + error.what(), "",
               "close other programs, or raise the limit of processes (ulimit -u)"};
}

}  // namespace palpate
