#include <algorithm>
#include <limits>
#include <new>
#include <numeric>
#include <utility>

#include "palpate/surfaces.h"
#include "preparation/touching.h"

namespace palpate {

Result<std::vector<std::vector<LabelId>>> touching_groups(const Volume<LabelId>& labels,
                                                          const std::vector<LabelId>& structures, int threads,
                                                          const Progress& progress) {
  std::vector<int> index(std::size_t{std::numeric_limits<LabelId>::max()} + 1, -1);
  for (std::size_t s = 0; s < structures.size(); ++s) index[structures[s]] = static_cast<int>(s);
  const auto touching =
      internal::find_touching(labels, index, structures.size(), internal::Common::kFaceEdgeOrCorner, threads,
                              progress, internal::ProgressSpan{"finding what touches"});
  if (!touching) return touching.error();

  std::vector<std::vector<LabelId>> groups;
  std::vector<char> taken(structures.size(), 0);
  for (std::size_t first = 0; first < structures.size(); ++first) {
    if (taken[first]) continue;
    std::vector<std::size_t> group{first};
    taken[first] = 1;
    for (std::size_t n = 0; n < group.size(); ++n)
      for (std::size_t s = 0; s < structures.size(); ++s)
        if (!taken[s] && (*touching)(group[n], s)) {
          taken[s] = 1;
          group.push_back(s);
        }
    std::sort(group.begin(), group.end());
    groups.emplace_back();
    for (const std::size_t s : group) groups.back().push_back(structures[s]);
  }
  return groups;
}

Result<std::vector<PreparedSurface>> prepare_outer_surfaces(const Volume<LabelId>& labels,
                                                            const std::vector<std::vector<LabelId>>& groups,
                                                            const SurfaceOptions& options,
                                                            const Progress& progress) {
  std::vector<LabelId> firsts;
  std::vector<LabelId> merged_label(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  std::iota(merged_label.begin(), merged_label.end(), LabelId{0});
  bool merge = false;
  for (const std::vector<LabelId>& group : groups) {
    firsts.push_back(group.front());
    for (const LabelId label : group) merged_label[label] = group.front();
    merge = merge || group.size() > 1;
  }
  if (!merge) return prepare_surfaces(labels, firsts, options, progress);
  Volume<LabelId> merged;
  try {
    merged = labels;
  } catch (const std::bad_alloc&) {
    return Error{ErrorKind::kBadInput, "not enough memory for the outer surfaces of structures that touch",
                 "", "close other programs, or crop the volume"};
  }
  for (LabelId& label : merged.voxels()) label = merged_label[label];
  return prepare_surfaces(merged, firsts, options, progress);
}

}  // namespace palpate
