#pragma once

#include "palpate/tissue/elastic_layout.h"

namespace palpate {

/// Calls visit(i, j, k) for all cells of a box, with i as innermost loop.
template <class Visit>
void for_each_cell(const CellBox& box, const Visit& visit) {
  for (int k = box.low[2]; k < box.high[2]; ++k)
    for (int j = box.low[1]; j < box.high[1]; ++j)
      for (int i = box.low[0]; i < box.high[0]; ++i) visit(i, j, k);
}

/// Calls visit(i, j, k) for all nodes of a box, those of its faces included.
template <class Visit>
void for_each_node(const CellBox& box, const Visit& visit) {
  for (int k = box.low[2]; k <= box.high[2]; ++k)
    for (int j = box.low[1]; j <= box.high[1]; ++j)
      for (int i = box.low[0]; i <= box.high[0]; ++i) visit(i, j, k);
}

}  // namespace palpate
