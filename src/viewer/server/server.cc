#include <atomic>
#include <exception>
#include <system_error>
#include <thread>
#include <utility>

#include "palpate/base/check.h"
#include "palpate/server/ordinary_thread.h"
#include "palpate/server/viewer_server.h"
#include "server/connection.h"
#include "server/hub.h"
#include "server/reachable.h"
#include "server/transport.h"

namespace palpate {
namespace server {
namespace {

constexpr int kMaxPort = 65535;

Error usage(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kUsage, std::move(what), std::move(where), std::move(remedy)};
}

Result<IpAddress> checked_address(const ViewerServerOptions& options) {
  const auto address = IpAddress::parse(options.address);
  if (!address)
    return usage("is not a numeric address", "--listen " + options.address,
                 "give an address of this machine, or 0.0.0.0 or :: for all of them");
  if (options.port < 0 || options.port > kMaxPort)
    return usage("is not a port", "--port " + std::to_string(options.port), "give a number from 1 to 65535");
  if (options.tls_certificate.empty() != options.tls_key.empty())
    return usage("a certificate needs its key, and a key its certificate",
                 options.tls_key.empty() ? "--tls-cert" : "--tls-key", "give both --tls-cert and --tls-key");
  if (!address->is_loopback() && options.token_file.empty())
    return usage("anyone who reaches this address could view and change the session",
                 "--listen " + options.address, "give --token-file FILE, or listen only at 127.0.0.1");
  return *address;
}

class Server : public ViewerServer {
 public:
  /// @param listener  belongs to `loop`
  Server(ViewerHost& host, const ViewerServerOptions& options, Tokens tokens, const IpAddress& address,
         std::unique_ptr<EventLoop> loop, std::unique_ptr<Listener> listener)
      : loop_(std::move(loop)),
        listener_(std::move(listener)),
        is_tls_(!options.tls_certificate.empty()),
        address_(reachable_address(listener_->address(), own_addresses(), listener_->is_v6_only())) {
    const ViewedScene& scene = host.scene();
    PALPATE_CHECK(scene.labels &&
                  (!scene.scan || scene.scan->geometry().dims == scene.labels->geometry().dims));
    const ScanScale scale = scene.scan ? ScanScale::of(*scene.scan) : ScanScale{};
    const VolumeFacts facts = facts_of(scene, scale);
    Access access(address.text(), port(), is_tls_, options.host_names, std::move(tokens));
    if (access.has_learners() && has_quiz(scene)) redaction_.emplace(scene);
    volumes_.emplace(volume_generator(scene.scan, scale, scene.labels, facts.wide_labels,
                                      redaction_ ? redaction_->scene().labels : nullptr,
                                      redaction_ && redaction_->has_wide_labels()));
    pictures_.emplace(host);
    site_.emplace(host, std::move(access), facts, redaction_ ? &*redaction_ : nullptr);
    // bytes that a single page downloads: scan and labels
    const std::size_t voxel_bytes = (scene.scan ? 2 : 0) + (facts.wide_labels ? 2 : 1);
    const DownloadRateLimiter downloads(scene.labels->geometry().voxel_count() * voxel_bytes,
                                        DownloadRateLimiter::Clock::now());
    hub_.emplace(*loop_, host, *site_, *volumes_, &*pictures_, downloads, FaultLog(options.log),
                 [this](int viewers) { viewers_ = viewers; });
    hub_->begin();
    listener_->accept([this](std::shared_ptr<HttpConnection> http) { take(std::move(http)); });
    thread_ = std::thread([this] { run(); });
  }

  ~Server() override {
    if (!thread_.joinable()) return;
    loop_->post([this] {
      listener_->close();
      hub_->end();
    });
    thread_.join();
    // stop these threads first, since they may still post to the loop
    volumes_.reset();
    pictures_.reset();
  }

  std::string url() const override {
    const std::string host = address_.is_v6() ? "[" + address_.text() + "]" : address_.text();
    return (is_tls_ ? "https://" : "http://") + host + ":" + std::to_string(port()) + "/";
  }
  int port() const override { return listener_->port(); }
  int viewers() const override { return viewers_; }

 private:
  void take(std::shared_ptr<HttpConnection> http) {
    hub_->make_room_for_connection();
    const auto connection = std::make_shared<Connection>(std::move(http), *hub_);
    hub_->add(connection);
    connection->begin();
  }

  void run() {
    use_ordinary_priority("viewers");
    // an exception from one connection's handler (out of memory) ends that handler only
    while (!loop_->is_stopped()) try {
        loop_->run();
      } catch (const std::exception&) {
        hub_->log().add("", "an error in the server");
      }
  }

  const std::unique_ptr<EventLoop> loop_;
  const std::unique_ptr<Listener> listener_;
  const bool is_tls_;
  const IpAddress address_;  // address in the published URL
  std::atomic<int> viewers_{0};
  std::optional<Redaction> redaction_;
  std::optional<PayloadStore> volumes_;
  std::optional<PictureStore> pictures_;
  std::optional<Site> site_;
  std::optional<Hub> hub_;
  std::thread thread_;
};

// files and addresses of the options, read and checked
struct Admission {
  IpAddress address;
  Tokens tokens;
  std::shared_ptr<TlsIdentity> tls;  // null: in the clear
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
  if (!options.tls_certificate.empty()) {
    auto tls = TlsIdentity::read(options.tls_certificate, options.tls_key);
    if (!tls) return tls.error();
    read.tls = *std::move(tls);
  }
  return read;
}

}  // namespace
}  // namespace server

Result<void> ViewerServer::check(ViewerServerOptions options) {
  options.log = {};
  const auto read = server::admission(options);
  if (!read) return read.error();
  return {};
}

Result<std::unique_ptr<ViewerServer>> ViewerServer::start(ViewerHost& host,
                                                          const ViewerServerOptions& options) try {
  auto read = server::admission(options);
  if (!read) return read.error();
  if (!read->address.is_loopback() && options.tls_certificate.empty() && options.log)
    options.log(
        "viewers: tokens and data cross the network unencrypted; --tls-cert and --tls-key encrypt them");

  // bind the socket before any expensive work
  auto loop = server::EventLoop::make();
  auto listener = loop->listen(read->address, options.port, std::move(read->tls));
  if (!listener)
    return Error{ErrorKind::kUnavailable, "cannot listen at this address: " + listener.error().what,
                 options.address + ":" + std::to_string(options.port),
                 "choose another --port, or close the program that uses this one"};
  return std::unique_ptr<ViewerServer>(std::make_unique<server::Server>(
      host, options, std::move(read->tokens), read->address, std::move(loop), *std::move(listener)));
} catch (const std::system_error& error) {
  return Error{ErrorKind::kUnavailable,
               std::string("cannot start the thread for the viewers: ") + error.what(), "",
               "close other programs, or raise the process limit (ulimit -u)"};
}

}  // namespace palpate
