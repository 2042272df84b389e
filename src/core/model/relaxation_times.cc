#include "model/relaxation_times.h"

#include <string>

namespace palpate {
namespace {

// relaxation series that are invalid
Result<void> check_relaxation(const Relaxation& relaxation) {
  const auto wrong = [](std::string what) {
    return Error{ErrorKind::kBadInput, std::move(what), "",
                 "give pairs of a fraction of the modulus, above 0 and with a sum below 1, and a time of "
                 "0.01 to 1000 s"};
  };
  for (const RelaxationTerm& term : relaxation.term) {
    if (term.fraction == 0 && term.time_s == 0) continue;
    if (!(term.fraction > 0 && term.fraction < 1))
      return wrong("a relaxation by " + std::to_string(term.fraction) + " of its modulus");
    if (!(term.time_s >= kRelaxationTimeRange.min_s && term.time_s <= kRelaxationTimeRange.max_s))
      return wrong("a relaxation time of " + std::to_string(term.time_s) + " s");
  }
  if (!(relaxation.total_fraction() < 1)) return wrong("a relaxation of the whole modulus");
  if (!relaxation.relaxes() && relaxation.total_fraction() > 0)
    return wrong("a relaxation whose first term is empty");
  return {};
}

}  // namespace

Result<RelaxationTimes> relaxation_times_of(std::span<const Tissue> tissues, TissueLaw law) {
  RelaxationTimes times;
  if (!is_elastic(law)) return times;
  for (const Tissue& tissue : tissues) {
    if (auto fine = check_relaxation(tissue.relaxation); !fine) {
      Error error = fine.error();
      error.what = "tissue \"" + tissue.name + "\" has " + error.what;
      return error;
    }
    if (tissue.elastic && tissue.touchable && !times.add(tissue.relaxation))
      return Error{
          ErrorKind::kBadInput,
          "the tissues relax with more than " + std::to_string(kMaxRelaxationTimes) + " different times", "",
          "give some of them the same `relaxation` times"};
  }
  return times;
}

}  // namespace palpate
