#include "server/access.h"

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
#include "palpate/base/learner.h"
#include "palpate/server/viewer_tokens.h"

namespace palpate::server {
namespace {

constexpr std::size_t kMinToken = 16, kMaxTokenFile_bytes = 64 << 10;
// below the first a token is refused, below the second a warning is logged
constexpr double kMinBits = 16, kGoodBits = 80;
// 32 mutually distinguishable characters; kNewToken of them amount to 130 bits
constexpr std::string_view kAlphabet = "abcdefghijkmnpqrstuvwxyz23456789";
constexpr std::size_t kNewToken = 26;

bool is_printable(char c) {
  return c > ' ' && c <= '~';
}

Error bad_line(const std::string& source, int line, std::string what) {
  return {ErrorKind::kBadInput, std::move(what), source + ":" + std::to_string(line),
          "create it with `palpate token`, or write lines of \"control TOKEN\", \"view TOKEN\", \"teacher "
          "TOKEN\" or \"learner TOKEN PSEUDONYM\", with tokens of at least " +
              std::to_string(kMinToken) + " random printable characters without blanks"};
}

std::optional<Role> role_named(std::string_view name) {
  const auto found = std::ranges::find_if(kRoles, [&](Role role) { return name_of(role) == name; });
  return found == kRoles.end() ? std::nullopt : std::optional(*found);
}

/// Removes the first word and the following blank.
std::string_view read_word(std::string_view& row) {
  const std::string_view word = row.substr(0, row.find(' '));
  row.remove_prefix(std::min(row.size(), word.size() + 1));
  return word;
}

Result<std::string> new_token() {
  std::array<unsigned char, kNewToken> random{};
  if (::getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size()))
    return Error{ErrorKind::kUnavailable, "the system's random number generator is not available",
                 "getrandom", "try again"};
  std::string token;
  for (const unsigned char byte : random) token += kAlphabet[byte % kAlphabet.size()];
  return token;
}

}  // namespace

double entropy_bound_bits(std::string_view token) {
  // reduce the token to its smallest period
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
    const bool continues = n > 0 && std::abs(token[n] - token[n - 1]) <= 1;
    bits += continues ? 1 : std::log2(characters);
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
    // the text may be a token, so no error message repeats it
    const auto role = role_named(read_word(row));
    if (!role) return bad_line(source, line, "this line names no role");
    const std::string_view token = *role == Role::kLearner ? read_word(row) : row;
    AuthenticatedViewer who{*role, *role == Role::kLearner ? std::string(row) : std::string()};
    if (token.size() < kMinToken || !std::all_of(token.begin(), token.end(), is_printable))
      return bad_line(source, line, "this line has no usable token");
    const double bits = entropy_bound_bits(token);
    if (bits < kMinBits) return bad_line(source, line, "this line's token is trivial to guess");
    if (bits < kGoodBits && warn)
      warn(source + ":" + std::to_string(line) +
           ": this token could be guessed; `palpate token` makes one that cannot");
    if (*role == Role::kLearner && !check_learner(who.learner))
      return bad_line(source, line, "this line has no pseudonym after its token");
    // a token in two lines would be ambiguous
    if (tokens.holder_of(token)) return bad_line(source, line, "this token is also used in another line");
    tokens.tokens_.push_back({digest_of(token), std::move(who)});
  }
  if (tokens.empty())
    return Error{ErrorKind::kBadInput, "there is no token in this file", source,
                 bad_line(source, 1, "").remedy};
  return tokens;
}

Result<Tokens> Tokens::read(const std::filesystem::path& file,
                            const std::function<void(const std::string&)>& warn) {
  const auto text = read_file(file, kMaxTokenFile_bytes);
  if (!text) return text.error();
  struct stat status;
  const mode_t mode = ::stat(file.c_str(), &status) == 0 ? status.st_mode : 0;
  if ((mode & S_IRWXO) != 0)
    return Error{
        ErrorKind::kBadInput, "every account of this machine can read or change these tokens", file.string(),
        "run chmod 600 on it; if another account may have read it, create new tokens (palpate token)"};
  if (warn && (mode & S_IRWXG) != 0)
    warn(file.string() + ": the group of its owner can read or change these tokens; run chmod 600 on it");
  return parse(*text, file.string(), warn);
}

Tokens::Digest Tokens::digest_of(std::string_view token) {
  Digest digest{};
  unsigned size = 0;
  PALPATE_CHECK(EVP_Digest(token.data(), token.size(), digest.data(), &size, EVP_sha256(), nullptr) == 1 &&
                size == digest.size());
  return digest;
}

std::optional<AuthenticatedViewer> Tokens::holder_of(std::string_view token) const {
  const Digest shown = digest_of(token);
  const Token* found = nullptr;
  // always compares with every token: constant time
  for (const Token& known : tokens_)
    if (CRYPTO_memcmp(known.digest.data(), shown.data(), shown.size()) == 0) found = &known;
  return found != nullptr ? std::optional(found->who) : std::nullopt;
}

std::vector<std::string> Tokens::learners() const {
  std::vector<std::string> names;
  for (const Token& token : tokens_)
    if (token.who.role == Role::kLearner && std::ranges::find(names, token.who.learner) == names.end())
      names.push_back(token.who.learner);
  return names;
}

bool Tokens::has(Role role) const {
  return std::ranges::any_of(tokens_, [role](const Token& token) { return token.who.role == role; });
}

}  // namespace palpate::server

namespace palpate {

Result<std::string> new_viewer_tokens(const NewTokens& requested) {
  const bool is_learner = requested.role == server::name_of(server::Role::kLearner);
  if (is_learner && requested.learner.empty())
    return Error{ErrorKind::kUsage, "a learner's token needs a pseudonym", "--role learner",
                 "give a pseudonym: --learner L042"};
  if (!is_learner && !requested.learner.empty())
    return Error{ErrorKind::kUsage, "only a learner's token has a pseudonym", "--learner",
                 "give --role learner, or leave it out"};
  if (is_learner)
    if (const auto named = check_learner(requested.learner); !named) return named.error();
  std::string text;
  for (const std::string& role :
       requested.role.empty() ? std::vector<std::string>{"control", "view"} : std::vector{requested.role}) {
    const auto token = server::new_token();
    if (!token) return token.error();
    text += role + " " + *token + (is_learner ? " " + requested.learner : "") + "\n";
  }
  return text;
}

Result<TokenHolders> holders_of_tokens(const std::filesystem::path& file) {
  const auto tokens = server::Tokens::read(file, {});
  if (!tokens) return tokens.error();
  return TokenHolders{tokens->learners(), tokens->has(server::Role::kTeacher)};
}

Result<void> write_viewer_tokens(const std::filesystem::path& file, const std::string& lines) {
  // mode 0600 from creation on, and O_EXCL so that existing tokens are never overwritten
  const int handle = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (handle < 0 && errno == EEXIST)
    return Error{ErrorKind::kOutput, "exists, and replacing it would revoke its tokens", file.string(),
                 "choose another name, or remove it first"};
  if (handle < 0) return output_error(file, errno);
  const bool written = ::write(handle, lines.data(), lines.size()) == static_cast<ssize_t>(lines.size()) &&
                       ::fsync(handle) == 0;
  const int why = errno;
  ::close(handle);
  if (written) return {};
  ::unlink(file.c_str());
  return output_error(file, why);
}

}  // namespace palpate
