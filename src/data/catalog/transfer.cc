#include "catalog/transfer.h"

#include <curl/curl.h>

#include <charconv>
#include <chrono>
#include <cstring>
#include <memory>

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

// state shared by the callbacks during one transfer
struct Exchange {
  const TransferBody& body;
  const TransferPoll& poll;
  double stall_timeout_s;
  TransferReply reply{};
  curl_off_t arrived = 0;
  Clock::time_point last_arrival = Clock::now();
  bool stopped = false;
  bool stalled = false;
};

std::optional<std::uint64_t> to_number(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, failed] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failed != std::errc() || end != text.data() + text.size()) return {};
  return value;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && std::strchr(" \t\r\n", text.front())) text.remove_prefix(1);
  while (!text.empty() && std::strchr(" \t\r\n", text.back())) text.remove_suffix(1);
  return text;
}

bool equal_ignoring_case(std::string_view a, std::string_view b) {
  return a.size() == b.size() && curl_strnequal(a.data(), b.data(), a.size());
}

// "bytes 100-199/200", "bytes */200", "bytes 100-199/*"
void read_content_range(std::string_view value, TransferReply& reply) {
  if (!value.starts_with("bytes ")) return;
  value.remove_prefix(6);
  const auto slash = value.find('/');
  if (slash == std::string_view::npos) return;
  reply.whole_size = to_number(trimmed(value.substr(slash + 1)));
  reply.range_start = to_number(trimmed(value.substr(0, std::min(slash, value.find('-')))));
}

std::size_t on_header(const char* data, std::size_t, std::size_t size, void* user) {
  auto& exchange = *static_cast<Exchange*>(user);
  const std::string_view line = trimmed({data, size});
  // each response in a chain of redirects resets the reply: "HTTP/1.1 206 Partial Content", "HTTP/2 200"
  if (line.starts_with("HTTP/")) {
    exchange.reply = {};
    const auto status = line.find(' ');
    if (status != std::string_view::npos)
      exchange.reply.status = static_cast<int>(to_number(line.substr(status + 1, 3)).value_or(0));
    return size;
  }
  const auto colon = line.find(':');
  if (colon == std::string_view::npos) return size;
  const std::string_view name = line.substr(0, colon), value = trimmed(line.substr(colon + 1));
  if (equal_ignoring_case(name, "Content-Range")) read_content_range(value, exchange.reply);
  if (equal_ignoring_case(name, "Content-Length") && exchange.reply.status == 200)
    exchange.reply.whole_size = to_number(value);
  return size;
}

std::size_t on_body(const char* data, std::size_t, std::size_t size, void* user) {
  auto& exchange = *static_cast<Exchange*>(user);
  const int status = exchange.reply.status;
  // the text of an error page is ignored
  if (status != 200 && status != 206) return size;
  if (exchange.body(exchange.reply, {data, size})) return size;
  exchange.stopped = true;
  return 0;
}

int on_progress(void* user, curl_off_t, curl_off_t arrived, curl_off_t, curl_off_t) {
  auto& exchange = *static_cast<Exchange*>(user);
  const auto now = Clock::now();
  if (arrived != exchange.arrived) {
    exchange.arrived = arrived;
    exchange.last_arrival = now;
  }
  exchange.stopped = exchange.stopped || !exchange.poll();
  exchange.stalled =
      std::chrono::duration<double>(now - exchange.last_arrival).count() > exchange.stall_timeout_s;
  return exchange.stopped || exchange.stalled ? 1 : 0;
}

TransferOutcome outcome_of(CURLcode code) {
  switch (code) {
    case CURLE_OK:
      return TransferOutcome::kDone;
    case CURLE_COULDNT_RESOLVE_HOST:
    case CURLE_COULDNT_RESOLVE_PROXY:
    case CURLE_PEER_FAILED_VERIFICATION:
    case CURLE_SSL_CACERT_BADFILE:
      return TransferOutcome::kUnreachable;
    case CURLE_UNSUPPORTED_PROTOCOL:
    case CURLE_URL_MALFORMAT:
    case CURLE_TOO_MANY_REDIRECTS:
      return TransferOutcome::kRefused;
    default:
      return TransferOutcome::kBroken;
  }
}

template <class Value>
void set(CURL* handle, CURLoption option, Value value) {
  curl_easy_setopt(handle, option, value);
}

}  // namespace

TransferResult transfer(const TransferRequest& request, const TransferBody& body, const TransferPoll& poll) {
  static const CURLcode kReady = curl_global_init(CURL_GLOBAL_DEFAULT);
  const std::unique_ptr<CURL, decltype(&curl_easy_cleanup)> handle(curl_easy_init(), &curl_easy_cleanup);
  if (kReady != CURLE_OK || !handle) return {TransferOutcome::kUnreachable, {}, "libcurl cannot be started"};

  Exchange exchange{body, poll, request.stall_timeout_s};
  const char* protocols = request.allow_http ? "http,https" : "https";
  const std::string range = std::to_string(request.first_byte) + "-";
  char why[CURL_ERROR_SIZE] = "";
  CURL* curl = handle.get();
  set(curl, CURLOPT_URL, request.url.c_str());
  set(curl, CURLOPT_PROTOCOLS_STR, protocols);
  set(curl, CURLOPT_REDIR_PROTOCOLS_STR, protocols);
  set(curl, CURLOPT_FOLLOWLOCATION, 1L);
  set(curl, CURLOPT_MAXREDIRS, 5L);
  set(curl, CURLOPT_NOSIGNAL, 1L);
  set(curl, CURLOPT_USERAGENT, "palpate");
  set(curl, CURLOPT_ERRORBUFFER, why);
  // not CURLOPT_RESUME_FROM: with it curl fails if a server ignores ranges
  if (request.first_byte > 0) set(curl, CURLOPT_RANGE, range.c_str());
  set(curl, CURLOPT_HEADERFUNCTION, &on_header);
  set(curl, CURLOPT_HEADERDATA, &exchange);
  set(curl, CURLOPT_WRITEFUNCTION, &on_body);
  set(curl, CURLOPT_WRITEDATA, &exchange);
  set(curl, CURLOPT_NOPROGRESS, 0L);
  set(curl, CURLOPT_XFERINFOFUNCTION, &on_progress);
  set(curl, CURLOPT_XFERINFODATA, &exchange);

  const CURLcode code = curl_easy_perform(curl);
  TransferResult result{outcome_of(code), exchange.reply, ""};
  if (code != CURLE_OK) result.reason = *why ? why : curl_easy_strerror(code);
  if (exchange.stalled) result = {TransferOutcome::kStalled, exchange.reply, "no more data arrived"};
  if (exchange.stopped) result.outcome = TransferOutcome::kStopped;
  return result;
}

}  // namespace palpate
