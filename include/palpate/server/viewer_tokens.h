#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "palpate/base/result.h"

/// Files of tokens, which give the viewers of a server their roles.
namespace palpate {

/// Roles for which new tokens are generated.
struct NewTokens {
  /// "view", "control", "learner" or "teacher"; empty: one token for control and one for view
  std::string role;
  std::string learner;  ///< Pseudonym, for the role of learner
};
/// Lines of a token file, each with a new token of 130 bits from the kernel's random number generator.
/// Errors: kBadInput for an invalid pseudonym, kUsage for a pseudonym without the role or the role without
/// one, kUnavailable if no random numbers are available.
Result<std::string> new_viewer_tokens(const NewTokens& requested = {});
/// Writes such lines to a new file that only its owner may read. Errors: kOutput if the file exists or cannot
/// be written; no partial file is left.
Result<void> write_viewer_tokens(const std::filesystem::path& file, const std::string& lines);
/// Holders of a file's tokens.
struct TokenHolders {
  std::vector<std::string> learners;
  bool teacher = false;
};
/// Errors: those of reading the file.
Result<TokenHolders> holders_of_tokens(const std::filesystem::path& file);

}  // namespace palpate
