#include "page_server.h"

#include <poll.h>
#include <unistd.h>

#include <utility>

namespace palpate::app {

void add_serving_options(CLI::App& verb, ServingOptions& options) {
  verb.add_option("--port", options.port,
                  "Port of the viewer's page, 0 for any free port; default: " + std::to_string(kViewerPort) +
                      " or the next free one")
      ->check(whole_between(0, 65535));
  verb.add_option("--listen", options.viewers.address,
                  "Numeric address of this machine to serve the page on; addresses other than loopback "
                  "require --token-file; default: 127.0.0.1");
  verb.add_option("--token-file", options.viewers.token_file,
                  "Permissions of viewers: lines \"view TOKEN\", \"control TOKEN\", \"teacher TOKEN\" and "
                  "\"learner TOKEN PSEUDONYM\" (palpate token)");
  verb.add_option("--tls-cert", options.viewers.tls_certificate,
                  "Certificate for https (PEM), with --tls-key");
  verb.add_option("--tls-key", options.viewers.tls_key, "Private key of the certificate (PEM)");
  verb.add_option("--host-name", options.viewers.host_names,
                  "Additional host name of the page; may be repeated");
  verb.add_option_function<int>(
          "--openigtlink",
          [&options](int port) {
            if (!options.openigtlink) options.openigtlink.emplace();
            options.openigtlink->port = port;
          },
          "Publish the tool, the force and the section by OpenIGTLink at this port, 0 for any free port; 3D "
          "Slicer expects " +
              std::to_string(kOpenIgtLinkPort))
      ->check(whole_between(0, 65535))
      ->type_name("PORT");
  verb.add_option_function<std::string>(
          "--openigtlink-listen",
          [&options](const std::string& address) {
            if (!options.openigtlink) options.openigtlink.emplace();
            options.openigtlink->address = address;
          },
          "Numeric address of this machine to publish on, without access control; default: 127.0.0.1")
      ->needs("--openigtlink")
      ->type_name("ADDRESS");
  verb.add_option_function<int>(
          "--ros2",
          [&options](int domain) {
            if (!options.ros2) options.ros2.emplace();
            options.ros2->domain = domain;
          },
          "Publish tool, force and distances to nodes of ROS 2 in this domain (ROS_DOMAIN_ID, usually 0)")
      ->check(whole_between(0, 101))
      ->type_name("DOMAIN");
  verb.add_option_function<std::string>(
          "--ros2-interface",
          [&options](const std::string& interface) {
            if (!options.ros2) options.ros2.emplace();
            options.ros2->interface = interface;
          },
          "Network interface, by name or address, to publish on, without access control; default: loopback")
      ->needs("--ros2")
      ->type_name("INTERFACE");
  verb.add_option_function<double>(
          "--ros2-rate",
          [&options](double rate_hz) {
            if (!options.ros2) options.ros2.emplace();
            options.ros2->rate_hz = rate_hz;
          },
          "Rate of the published poses and forces, Hz; default: 250")
      ->check(CLI::Range(1.0, 1000.0))
      ->needs("--ros2")
      ->type_name("HZ");
}

void ViewerFaultQueue::enqueue(const std::string& line) {
  const std::lock_guard lock(mutex_);
  if (lines_.size() < kMaxLines) lines_.push_back(line);
}

void ViewerFaultQueue::show_next(Console& console) {
  pollfd terminal{console.streams().err, POLLOUT, 0};
  if (::poll(&terminal, 1, 0) != 1) return;
  std::string line;
  {
    const std::lock_guard lock(mutex_);
    if (lines_.empty()) return;
    line = std::move(lines_.front());
    lines_.pop_front();
  }
  console.note(line);
}

Result<std::unique_ptr<ViewerServer>> serve(ViewerHost& host, const ServingOptions& options, Console& console,
                                            ViewerFaultQueue& faults) {
  constexpr int kTries = 20;
  ViewerServerOptions settings = options.viewers;
  settings.port = options.port.value_or(kViewerPort);
  settings.log = [&faults](const std::string& fault) { faults.enqueue(fault); };
  auto server = ViewerServer::start(host, settings);
  if (options.port) return server;
  for (int tries = 1; tries < kTries && !server && server.error().kind == ErrorKind::kUnavailable; ++tries) {
    ++settings.port;
    auto next = ViewerServer::start(host, settings);
    if (next) console.note("port " + std::to_string(kViewerPort) + " is taken");
    // if the address itself is unavailable, the error of the first attempt is returned
    if (next) return next;
  }
  return server;
}

Result<Publishers> publish(ViewerHost& host, const ServingOptions& options, Console& console,
                           ViewerFaultQueue& faults) {
  Publishers publishers;
  if (options.openigtlink) {
    OpenIgtLinkOptions settings = *options.openigtlink;
    settings.log = [&faults](const std::string& fault) { faults.enqueue(fault); };
    auto server = OpenIgtLinkServer::start(host, settings);
    if (!server) return server.error();
    console.note("OpenIGTLink at " + settings.address + " port " + std::to_string((*server)->port()));
    publishers.openigtlink = *std::move(server);
  }
  if (options.ros2) {
    auto publisher = Ros2Publisher::start(host, *options.ros2);
    if (!publisher) return publisher.error();
    console.note("ROS 2 in domain " + std::to_string(options.ros2->domain) + " on " +
                 (options.ros2->interface.empty() ? "loopback" : options.ros2->interface));
    publishers.ros2 = *std::move(publisher);
  }
  return publishers;
}

}  // namespace palpate::app
