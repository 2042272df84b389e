#include "link/access.h"

#include <fcntl.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>

#include "palpate/base/file.h"

namespace palpate::link {
namespace {

constexpr std::size_t kLeastToken = 16, kMostTokenFile_bytes = 64 << 10;
// below the first a token is refused, below the second it is warned of
constexpr double kLeastBits = 16, kGoodBits = 80;
// 32 characters of which none looks like another, and so many of them that there are 130 bits
constexpr std::string_view kAlphabet = "abcdefghijkmnpqrstuvwxyz23456789";
constexpr std::size_t kNewToken = 26;
constexpr int kHttpPort = 80, kHttpsPort = 443;

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}
// names of hosts and schemes know no upper case
bool same_name(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](char x, char y) { return lower(x) == lower(y); });
}

// as it stands in a Host: an IPv6 address in brackets
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

bool is_printable(char c) {
  return c > ' ' && c <= '~';
}

Error bad_line(const std::string& source, int line, std::string what) {
  return {
      ErrorKind::kBadInput, std::move(what), source + ":" + std::to_string(line),
      "let `palpate token` make it, or write lines of \"control TOKEN\" or \"view TOKEN\", with tokens of at "
      "least " +
          std::to_string(kLeastToken) + " printable characters without blanks, as random as you can"};
}

Result<std::string> new_token() {
  std::array<unsigned char, kNewToken> random{};
  if (::getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size()))
    return Error{ErrorKind::kUnavailable, "the system gives no random numbers", "getrandom", "try again"};
  std::string token;
  for (const unsigned char byte : random) token += kAlphabet[byte % kAlphabet.size()];
  return token;
}

}  // namespace

double most_bits(std::string_view token) {
  // the piece that all of it repeats
  std::size_t piece = 1;
  while (piece < token.size() && token.substr(piece) != token.substr(0, token.size() - piece)) ++piece;
  token = token.substr(0, piece);
  const auto any = [&](auto kind) { return std::any_of(token.begin(), token.end(), kind); };
  const auto is_lower = [](char c) { return c >= 'a' && c <= 'z'; };
  const auto is_upper = [](char c) { return c >= 'A' && c <= 'Z'; };
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const auto is_other = [&](char c) { return !is_lower(c) && !is_upper(c) && !is_digit(c); };
  const int characters = 26 * any(is_lower) + 26 * any(is_upper) + 10 * any(is_digit) + 32 * any(is_other);
  double bits = 0;
  for (std::size_t n = 0; n < token.size(); ++n) {
    const bool goes_on = n > 0 && std::abs(token[n] - token[n - 1]) <= 1;
    bits += goes_on ? 1 : std::log2(characters);
  }
  return bits;
}

Result<Tokens> Tokens::parse(std::string_view text, const std::string& source,
                             const std::function<void(const std::string&)>& warn) {
  Tokens tokens;
  for (int line = 1; !text.empty(); ++line) {
    std::string_view row = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), row.size() + 1));
    if (row.ends_with('\r')) row.remove_suffix(1);
    if (row.empty() || row.starts_with('#')) continue;
    const std::size_t blank = std::min(row.find(' '), row.size());
    const std::string_view role = row.substr(0, blank), token = row.substr(std::min(blank + 1, row.size()));
    // what stands there may be a token: no error repeats it
    if (role != "control" && role != "view") return bad_line(source, line, "this line names no role");
    if (token.size() < kLeastToken || !std::all_of(token.begin(), token.end(), is_printable))
      return bad_line(source, line, "this line has no usable token");
    const double bits = most_bits(token);
    if (bits < kLeastBits) return bad_line(source, line, "this line's token is guessed at once");
    if (bits < kGoodBits && warn)
      warn(source + ":" + std::to_string(line) +
           ": this token could be guessed; `palpate token` makes one that cannot");
    tokens.tokens_.push_back({digest_of(token), role == "control" ? Role::kControl : Role::kView});
  }
  if (tokens.empty())
    return Error{ErrorKind::kBadInput, "there is no token in this file", source,
                 bad_line(source, 1, "").remedy};
  return tokens;
}

Result<Tokens> Tokens::read(const std::filesystem::path& file,
                            const std::function<void(const std::string&)>& warn) {
  const auto text = read_file(file, kMostTokenFile_bytes);
  if (!text) return text.error();
  struct stat status;
  if (warn && ::stat(file.c_str(), &status) == 0 && (status.st_mode & (S_IRWXG | S_IRWXO)) != 0)
    warn(file.string() + ": others than its owner may read the tokens; chmod 600 it");
  return parse(*text, file.string(), warn);
}

Tokens::Digest Tokens::digest_of(std::string_view token) {
  Digest digest{};
  unsigned size = 0;
  PALPATE_CHECK(EVP_Digest(token.data(), token.size(), digest.data(), &size, EVP_sha256(), nullptr) == 1 &&
                size == digest.size());
  return digest;
}

std::optional<Role> Tokens::role_of(std::string_view token) const {
  const Digest shown = digest_of(token);
  std::optional<Role> role;
  // all of them, always
  for (const Token& known : tokens_)
    if (CRYPTO_memcmp(known.digest.data(), shown.data(), shown.size()) == 0) role = known.role;
  return role;
}

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
  if (tokens_.empty()) return {Role::kControl};
  // who shows none guesses nothing
  if (token.empty()) return {};
  if (!guesses_.may_guess(from, now)) return {std::nullopt, true};
  const auto role = tokens_.role_of(token);
  if (!role) guesses_.guessed_wrong(from, now);
  return {role};
}

std::string_view Access::bearer(std::string_view authorization) {
  constexpr std::string_view kScheme = "bearer ";
  if (!same_name(authorization.substr(0, kScheme.size()), kScheme)) return {};
  return authorization.substr(kScheme.size());
}

}  // namespace palpate::link

namespace palpate {

Result<std::string> new_viewer_tokens() {
  std::string text;
  for (const char* role : {"control ", "view "}) {
    const auto token = link::new_token();
    if (!token) return token.error();
    text += role + *token + "\n";
  }
  return text;
}

Result<void> write_viewer_tokens(const std::filesystem::path& file) {
  const auto text = new_viewer_tokens();
  if (!text) return text.error();
  // nobody else's from the first moment, and never in the place of tokens that somebody has
  const int handle = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (handle < 0 && errno == EEXIST)
    return Error{ErrorKind::kOutput, "is there already, and whoever has its tokens would lose his way in",
                 file.string(), "choose another name, or remove it first"};
  if (handle < 0) return output_error(file, errno);
  const bool written = ::write(handle, text->data(), text->size()) == static_cast<ssize_t>(text->size()) &&
                       ::fsync(handle) == 0;
  const int why = errno;
  ::close(handle);
  if (written) return {};
  ::unlink(file.c_str());
  return output_error(file, why);
}

}  // namespace palpate
