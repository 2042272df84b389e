#pragma once

#include <string>

#include "palpate/base/result.h"

namespace palpate {

/// Checks a learner's pseudonym: 1 to 64 bytes of UTF-8 on one line, without terminal control characters.
/// Errors: kBadInput otherwise.
Result<void> check_learner(const std::string& learner);

}  // namespace palpate
