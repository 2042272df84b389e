#include <algorithm>
#include <limits>
#include <new>
#include <numeric>
#include <optional>
#include <utility>

#include "palpate/base/disjoint_sets.h"
#include "palpate/surfaces/surfaces.h"
#include "surfaces/touching.h"

namespace palpate {

Result<std::vector<std::pair<LabelId, LabelId>>> touching_pairs(const Bricks<LabelId>& labels,
                                                                const std::vector<LabelId>& structures,
                                                                int threads, const Progress& progress) {
  std::vector<int> index(std::size_t{std::numeric_limits<LabelId>::max()} + 1, -1);
  for (std::size_t s = 0; s < structures.size(); ++s) index[structures[s]] = static_cast<int>(s);
  const auto touching =
      internal::find_touching(labels, index, structures.size(), internal::Adjacency::kFaceEdgeOrCorner,
                              threads, progress, internal::ProgressSpan{"finding what touches"});
  if (!touching) return touching.error();
  std::vector<std::pair<LabelId, LabelId>> pairs;
  for (std::size_t a = 0; a < structures.size(); ++a)
    for (std::size_t b = a + 1; b < structures.size(); ++b)
      if ((*touching)(a, b)) pairs.emplace_back(structures[a], structures[b]);
  return pairs;
}

std::vector<std::vector<LabelId>> touching_groups(const std::vector<LabelId>& structures,
                                                  const std::vector<std::pair<LabelId, LabelId>>& touching) {
  constexpr int kNone = -1;
  std::vector<int> index_of(std::size_t{std::numeric_limits<LabelId>::max()} + 1, kNone);
  DisjointSets sets;
  for (const LabelId structure : structures) index_of[structure] = static_cast<int>(sets.add());
  for (const auto& [a, b] : touching)
    if (index_of[a] != kNone && index_of[b] != kNone)
      sets.join(static_cast<std::uint32_t>(index_of[a]), static_cast<std::uint32_t>(index_of[b]));

  std::vector<std::vector<LabelId>> groups;
  std::vector<std::size_t> group_of(structures.size());
  for (std::uint32_t s = 0; s < structures.size(); ++s) {
    const std::uint32_t first = sets.root(s);
    if (first == s) {
      group_of[s] = groups.size();
      groups.emplace_back();
    }
    groups[group_of[first]].push_back(structures[s]);
  }
  return groups;
}

Result<std::vector<std::shared_ptr<const Surface>>> prepare_outer_surfaces(
    const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
    const SurfaceOptions& options, const Progress& progress) {
  std::vector<std::shared_ptr<const Surface>> surfaces;
  // the intermediate data, as large as the surface itself, is discarded here
  const auto visit = [&](PreparedSurface one) {
    surfaces.push_back(std::make_shared<const Surface>(std::move(one.surface)));
  };
  const auto of =
      [&](const Bricks<LabelId>& merged,
          const std::vector<LabelId>& firsts) -> Result<std::vector<std::shared_ptr<const Surface>>> {
    const auto done = prepare_each_surface(merged, firsts, options, visit, progress);
    if (!done) return done.error();
    return std::move(surfaces);
  };
  std::vector<LabelId> firsts;
  std::vector<LabelId> merged_label(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  std::iota(merged_label.begin(), merged_label.end(), LabelId{0});
  bool merge = false;
  for (const std::vector<LabelId>& group : groups) {
    firsts.push_back(group.front());
    for (const LabelId label : group) merged_label[label] = group.front();
    merge = merge || group.size() > 1;
  }
  if (!merge) return of(labels, firsts);
  std::optional<Bricks<LabelId>> merged;
  try {
    merged = Bricks<LabelId>::of_labels(labels, merged_label);
  } catch (const std::bad_alloc&) {
    return Error{ErrorKind::kBadInput, "not enough memory for the outer surfaces of structures that touch",
                 "", "close other programs, or crop the volume"};
  }
  return of(*merged, firsts);
}

}  // namespace palpate
