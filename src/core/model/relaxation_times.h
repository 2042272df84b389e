#pragma once

#include <span>

#include "palpate/contact/model.h"

namespace palpate {

/// Relaxation times of the tissues that are deformable under a law. Errors: kBadInput for an invalid series,
/// or more different times than supported.
Result<RelaxationTimes> relaxation_times_of(std::span<const Tissue> tissues, TissueLaw law);

}  // namespace palpate
