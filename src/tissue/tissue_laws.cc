#include "palpate/tissue/tissue_laws.h"

#include <algorithm>
#include <iterator>

#include "palpate/base/check.h"

namespace palpate {

static_assert(static_cast<std::uint32_t>(TissueLaw::kChainMail) < ModelChange::kLaws);

TissueLaw law_of(const ModelChange& change) {
  PALPATE_CHECK(change.is_of_law());
  return static_cast<TissueLaw>(change.tissue - ModelChange::kLaw);
}

void LawsByVersion::hear(const ModelChange& change) {
  // whatever a file says, versions rise
  if (change.is_of_law() && change.version >= laws_.back().first)
    laws_.emplace_back(change.version, law_of(change));
}

TissueLaw LawsByVersion::at(std::uint32_t version) const {
  const auto later =
      std::ranges::upper_bound(laws_, version, {}, &std::pair<std::uint32_t, TissueLaw>::first);
  return std::prev(later)->second;
}

}  // namespace palpate
