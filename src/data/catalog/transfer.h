#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

/// A single HTTP(S) request; the only code that uses libcurl.
namespace palpate {

struct TransferRequest {
  std::string url;
  bool allow_http = false;       ///< Allow plain http, also after a redirect; otherwise https only.
  std::uint64_t first_byte = 0;  ///< If > 0, requests the file from this offset on; bytes.
  double stall_timeout_s = 20;   ///< Maximum time without receiving a byte.
};

/// Status and headers, received before the body.
struct TransferReply {
  int status = 0;                            ///< HTTP status of the last response.
  std::optional<std::uint64_t> range_start;  ///< Offset from Content-Range, if it is present.
  std::optional<std::uint64_t> whole_size;   ///< Size of the whole file, if the server states it.
};

enum class TransferOutcome : std::uint8_t {
  kDone,         ///< The whole response was received, whatever its status.
  kBroken,       ///< The connection failed or ended early: worth retrying.
  kStalled,      ///< Nothing was received for stall_timeout_s: worth retrying.
  kUnreachable,  ///< Unknown host or invalid certificate.
  kRefused,      ///< Rejected by palpate: a URL that is not https, or too many redirects.
  kStopped,      ///< Cancelled by one of the callbacks.
};

struct TransferResult {
  TransferOutcome outcome = TransferOutcome::kDone;
  TransferReply reply;
  std::string reason;  ///< Reason for the user, unless kDone.
};

/// Called for every piece of the body of a response with status 200 or 206; returning false cancels the
/// transfer.
using TransferBody = std::function<bool(const TransferReply& reply, std::string_view bytes)>;
/// Called at least once a second; returning false cancels the transfer.
using TransferPoll = std::function<bool()>;

TransferResult transfer(const TransferRequest& request, const TransferBody& body, const TransferPoll& poll);

}  // namespace palpate
