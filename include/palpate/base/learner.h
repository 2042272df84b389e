#pragma once

#include <string>

#include "palpate/base/result.h"

namespace palpate {

/// Whether a text can be a learner's pseudonym: 1 to 64 bytes of UTF-8 on a line, nothing in it that commands
/// a terminal. Error kBadInput.
Result<void> check_learner(const std::string& learner);

}  // namespace palpate
