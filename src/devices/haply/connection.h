#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "haply/messages.h"
#include "palpate/base/result.h"
#include "palpate/haply/haply_driver.h"

namespace palpate::haply {

/// Finds the service and its version by HTTP; force_key() tells whether the version is supported. Error
/// kUnavailable if none answers. Takes some seconds at most, and returns immediately if the port is closed.
Result<ServiceVersion> find_service(const HaplySettings& settings);

/// A WebSocket connection to the service, used by one thread at a time. Every call is bounded in time.
class Connection {
 public:
  /// @param port  WebSocket port of the settings
  /// Error kUnavailable. Takes two seconds at most.
  static Result<std::unique_ptr<Connection>> open(const HaplySettings& settings, std::uint16_t port);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  enum class Received { kMessage, kNothing, kLost };
  /// Receives the next message, or kNothing if the time is over. Once the connection is lost every call
  /// returns kLost.
  /// @param until_ns  deadline, on the clock of monotonic_ns()
  Received receive(std::string& text, std::int64_t until_ns);
  /// Returns false if the connection is lost. Blocks at most 10 ms if the service does not read.
  bool send(std::string_view text);

 private:
  class Stream;
  explicit Connection(std::unique_ptr<Stream> stream);
  std::unique_ptr<Stream> stream_;
};

}  // namespace palpate::haply
