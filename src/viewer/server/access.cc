#include "server/access.h"

#include <algorithm>
#include <utility>

namespace palpate::server {
namespace {

constexpr int kHttpPort = 80, kHttpsPort = 443;

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}
// host names and schemes are case-insensitive
bool same_name(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](char x, char y) { return lower(x) == lower(y); });
}

// form in a Host header: an IPv6 address is bracketed
std::string in_host(std::string_view address) {
  if (address.find(':') == std::string_view::npos) return std::string(address);
  std::string text = "[";
  text += address;
  return text + "]";
}

// "name:8480", "[::1]:8480"
bool says_port(std::string_view name) {
  const std::size_t colon = name.rfind(':'), bracket = name.rfind(']');
  return colon != name.npos && (bracket == name.npos || colon > bracket);
}

}  // namespace

Access::Access(std::string address, int port, bool tls, std::vector<std::string> host_names, Tokens tokens)
    : port_(port), tls_(tls), names_(std::move(host_names)), tokens_(std::move(tokens)) {
  for (const char* name : {"localhost", "127.0.0.1", "[::1]"}) names_.emplace_back(name);
  names_.push_back(in_host(address));
}

bool Access::is_name_with_port(std::string_view host, std::string_view name) const {
  const bool default_port = port_ == (tls_ ? kHttpsPort : kHttpPort);
  if (same_name(host, name)) return says_port(name) || default_port;
  return !says_port(name) && same_name(host, std::string(name) + ":" + std::to_string(port_));
}

bool Access::serves(std::string_view host, std::string_view local_address) const {
  return is_name_with_port(host, in_host(local_address)) ||
         std::any_of(names_.begin(), names_.end(),
                     [&](const std::string& name) { return is_name_with_port(host, name); });
}

bool Access::is_own_origin(std::string_view origin, std::string_view host) const {
  const std::string_view scheme = tls_ ? "https://" : "http://";
  return origin.empty() ||
         (origin.size() > scheme.size() && same_name(origin.substr(0, scheme.size()), scheme) &&
          same_name(origin.substr(scheme.size()), host));
}

Access::Admission Access::admit(std::string_view token, const AddressBlock& from,
                                GuessLimit::Clock::time_point now) {
  if (tokens_.empty()) return {AuthenticatedViewer{Role::kControl, {}}};
  // a missing token is not a guess
  if (token.empty()) return {};
  if (!guesses_.may_check_token(from, now)) return {std::nullopt, true};
  auto who = tokens_.holder_of(token);
  if (!who) guesses_.guessed_wrong(from, now);
  return {std::move(who)};
}

std::string_view Access::bearer(std::string_view authorization) {
  constexpr std::string_view kScheme = "bearer ";
  if (!same_name(authorization.substr(0, kScheme.size()), kScheme)) return {};
  return authorization.substr(kScheme.size());
}

}  // namespace palpate::server
