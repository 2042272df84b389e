#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "haply/messages.h"
#include "palpate/base/result.h"
#include "palpate/haply/haply_driver.h"

namespace palpate::haply {

/// Which service listens there, asked by HTTP; force_key() says whether its version is known. Error
/// kUnavailable where none answers. Takes some seconds at most, and a moment where nobody listens.
Result<ServiceVersion> find_service(const HaplySettings& settings);

/// A WebSocket to the service, of one thread at a time. No call waits longer than it says.
class Connection {
 public:
  /// @param port  of the settings
  /// Error kUnavailable. Takes two seconds at most.
  static Result<std::unique_ptr<Connection>> open(const HaplySettings& settings, std::uint16_t port);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  enum class Received { kMessage, kNothing, kLost };
  /// The next message, or nothing until then; a call after a lost one is lost.
  /// @param until_ns  of monotonic_ns()
  Received receive(std::string& text, std::int64_t until_ns);
  /// False: lost. Waits a hundredth of a second at most, where the service does not read.
  bool send(std::string_view text);

 private:
  class Stream;
  explicit Connection(std::unique_ptr<Stream> stream);
  std::unique_ptr<Stream> stream_;
};

}  // namespace palpate::haply
