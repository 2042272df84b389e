#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "server/guess_limit.h"
#include "server/permissions.h"

/// Authentication and permissions (docs/reference/viewer-protocol.md, "Who may").
namespace palpate::server {

/// Tokens of a file, stored as digests, so that comparison takes constant time.
class Tokens {
 public:
  /// Parses lines "control TOKEN", "view TOKEN", "teacher TOKEN" and "learner TOKEN PSEUDONYM"; blank lines
  /// and those that begin with '#' are skipped.
  /// @param warn  receives the lines with weak tokens
  static Result<Tokens> parse(std::string_view text, const std::string& source,
                              const std::function<void(const std::string&)>& warn = {});
  /// Errors: those of read_file() and parse(), and a file that every account of the machine can read or
  /// write.
  /// @param warn  also reports a file that its owner's group can read or write
  static Result<Tokens> read(const std::filesystem::path& file,
                             const std::function<void(const std::string&)>& warn);

  bool empty() const { return tokens_.empty(); }
  /// Holder of a token; empty for an unknown token.
  std::optional<AuthenticatedViewer> holder_of(std::string_view token) const;
  /// Pseudonyms in the order of the file, without duplicates.
  std::vector<std::string> learners() const;
  bool has(Role role) const;

 private:
  using Digest = std::array<unsigned char, 32>;
  struct Token {
    Digest digest;
    AuthenticatedViewer who;
  };
  static Digest digest_of(std::string_view token);

  std::vector<Token> tokens_;
};

/// Upper bound of a token's entropy in bits: log2 of the alphabet size per character, 1 per character that
/// continues a run (aaaa, abcd, 4321), and a repeated piece counted once. Dictionary words are not
/// recognised.
double entropy_bound_bits(std::string_view token);

/// Checks host names, origins and tokens of requests.
class Access {
 public:
  /// @param address     numeric address of the listening socket
  /// @param host_names  additional names, or NAME:PORT
  Access(std::string address, int port, bool tls, std::vector<std::string> host_names, Tokens tokens);

  /// Whether the server answers requests with this `Host`.
  /// @param local_address  numeric address at which the connection arrived
  bool serves(std::string_view host, std::string_view local_address) const;
  /// Whether `origin` is the server's own page as addressed by `host`. Empty: the request comes from no page.
  bool is_own_origin(std::string_view origin, std::string_view host) const;
  /// Result of admitting a viewer with a token, or without one (empty).
  struct Admission {
    std::optional<AuthenticatedViewer> who;  ///< Empty: rejected
    bool too_many_guesses = false;           ///< The token was not checked, because of GuessLimit
  };
  Admission admit(std::string_view token, const AddressBlock& from, GuessLimit::Clock::time_point now);
  /// Called about every 100 ms, so that an address is forgotten a second after its last wrong token.
  void forget_inactive_guesses(GuessLimit::Clock::time_point now) { guesses_.forget_inactive(now); }
  /// Number of addresses for which a wrong token is remembered.
  std::size_t addresses_remembered() const { return guesses_.addresses(); }
  /// Token in "Bearer TOKEN"; empty if malformed.
  static std::string_view bearer(std::string_view authorization);

  bool has_learners() const { return tokens_.has(Role::kLearner); }
  /// Pseudonyms of all learners that have a token.
  std::vector<std::string> learners() const { return tokens_.learners(); }
  bool tls() const { return tls_; }
  int port() const { return port_; }

 private:
  bool is_name_with_port(std::string_view host, std::string_view name) const;

  int port_;
  bool tls_;
  std::vector<std::string> names_;
  Tokens tokens_;
  GuessLimit guesses_;
};

}  // namespace palpate::server
