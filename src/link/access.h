#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "link/guess_limit.h"
#include "link/rights.h"
#include "palpate/base/result.h"

/// Who may see and who may change (docs/reference/viewer-protocol.md, "Who may").
namespace palpate::link {

/// The tokens of a file. Kept as digests: they are compared in the same time whatever was shown.
class Tokens {
 public:
  /// Lines "control TOKEN", "view TOKEN", "teacher TOKEN" and "learner TOKEN PSEUDONYM"; blank ones and those
  /// that begin with '#' are skipped.
  /// @param warn  told the lines whose tokens could be guessed
  static Result<Tokens> parse(std::string_view text, const std::string& source,
                              const std::function<void(const std::string&)>& warn = {});
  /// Errors: those of read_file() and parse(), and a file that every account of the machine may read or
  /// change.
  /// @param warn  also reports a file that its owner's group may read or change
  static Result<Tokens> read(const std::filesystem::path& file,
                             const std::function<void(const std::string&)>& warn);

  bool empty() const { return tokens_.empty(); }
  /// Nothing for an unknown token.
  std::optional<Who> who_shows(std::string_view token) const;
  /// In the order of the file, each once.
  std::vector<std::string> learners() const;
  bool has(Role role) const;

 private:
  using Digest = std::array<unsigned char, 32>;
  struct Token {
    Digest digest;
    Who who;
  };
  static Digest digest_of(std::string_view token);

  std::vector<Token> tokens_;
};

/// How many bits a token has at most: of random characters of its kinds all, of those that go on from the one
/// before (aaaa, abcd, 4321) one each, of a piece that is repeated the piece. Words are not known.
double most_bits(std::string_view token);

/// Who is asked, where and for whom.
class Access {
 public:
  /// @param address     that the server listens at, numeric
  /// @param host_names  further names, or NAME:PORT
  Access(std::string address, int port, bool tls, std::vector<std::string> host_names, Tokens tokens);

  /// Whether the server answers to this `Host`.
  /// @param local_address  where the connection arrived, numeric
  bool serves(std::string_view host, std::string_view local_address) const;
  /// Whether a page of that origin is the server's own, as asked for by `host`. Empty: no page.
  bool is_own_origin(std::string_view origin, std::string_view host) const;
  /// Who comes with a token, or with none (empty).
  struct Admission {
    std::optional<Who> who;         ///< nothing: not let in
    bool too_many_guesses = false;  ///< the token was not looked at: GuessLimit
  };
  Admission admit(std::string_view token, const AddressBlock& from, GuessLimit::Clock::time_point now);
  /// Called about every 100 ms, so that nothing is known of an address a second after its last wrong token.
  void forget_guesses(GuessLimit::Clock::time_point now) { guesses_.forget_the_quiet(now); }
  /// Addresses of which a wrong token is remembered.
  std::size_t addresses_remembered() const { return guesses_.addresses(); }
  /// The token of "Bearer TOKEN"; empty where it is none.
  static std::string_view bearer(std::string_view authorization);

  bool has_learners() const { return tokens_.has(Role::kLearner); }
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

}  // namespace palpate::link
