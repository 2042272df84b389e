#include "palpate/base/learner.h"

#include "palpate/base/printable.h"

namespace palpate {

Result<void> check_learner(const std::string& learner) {
  constexpr std::size_t kMax_bytes = 64;
  if (learner.empty() || learner.size() > kMax_bytes || printable_name(learner) != learner)
    return Error{ErrorKind::kBadInput, "\"" + printable_name(learner) + "\" cannot be a learner's pseudonym",
                 "", "1 to 64 bytes of letters, digits and marks on one line, such as L042"};
  return {};
}

}  // namespace palpate
