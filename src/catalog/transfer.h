#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

/// One HTTP(S) request. The only place that meets libcurl.
namespace palpate {

struct TransferRequest {
  std::string url;
  bool allow_http = false;       ///< plain http, also after a redirect; else https alone
  std::uint64_t first_byte = 0;  ///< > 0: asks for the rest of the file from here
  double stall_timeout_s = 20;   ///< without a byte for so long the transfer ends
};

/// What the server said before it sent the body.
struct TransferReply {
  int status = 0;                            ///< HTTP status of the last answer
  std::optional<std::uint64_t> range_start;  ///< of Content-Range, when it names one
  std::optional<std::uint64_t> whole_size;   ///< of the whole file, when the server says it
};

enum class TransferOutcome : std::uint8_t {
  kDone,         ///< the whole answer arrived, whatever its status
  kBroken,       ///< the connection failed or ended early: worth another try
  kStalled,      ///< nothing arrived for stall_timeout_s: worth another try
  kUnreachable,  ///< no such host, or its certificate is wrong
  kRefused,      ///< by us: an address that is not https, or redirects without end
  kStopped,      ///< one of the two callbacks asked for it
};

struct TransferResult {
  TransferOutcome outcome = TransferOutcome::kDone;
  TransferReply reply;
  std::string reason;  ///< in words, when it is not kDone
};

/// Called for every piece of the body of an answer with status 200 or 206; false ends the transfer.
using TransferBody = std::function<bool(const TransferReply& reply, std::string_view bytes)>;
/// Called at least once a second; false ends the transfer.
using TransferPoll = std::function<bool()>;

TransferResult transfer(const TransferRequest& request, const TransferBody& body, const TransferPoll& poll);

}  // namespace palpate
