#pragma once

#include <algorithm>
#include <span>

namespace palpate {

/// Stable insertion sort of a few elements in place. It does not allocate, which std::stable_sort may do.
/// @param before  strict weak ordering
template <class T, class Before>
void insertion_sort(std::span<T> few, Before before) {
  for (auto next = few.begin(); next != few.end(); ++next)
    std::rotate(std::upper_bound(few.begin(), next, *next, before), next, next + 1);
}

}  // namespace palpate
