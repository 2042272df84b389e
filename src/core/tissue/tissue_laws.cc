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

void LawHistory::on_event(const ModelChange& change) {
  // versions increase for any file content
  if (!change.is_of_law() || change.version < laws_.back().version) return;
  const double cell_factor = change.contact.stiffness_N_per_mm;
  const bool reports_cells = cell_factor >= 1 && cell_factor <= kMaxTissueCellFactor;
  laws_.push_back({change.version, law_of(change), reports_cells ? cell_factor : laws_.back().cell_factor});
}

const LawHistory::From& LawHistory::from(std::uint32_t version) const {
  return *std::prev(std::ranges::upper_bound(laws_, version, {}, &From::version));
}

}  // namespace palpate
