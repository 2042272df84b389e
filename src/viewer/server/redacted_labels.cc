#include "server/redacted_labels.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>

namespace palpate::server {
namespace {

/// Share of a component's votes above which all of it becomes one structure. If a structure's layer is
/// curved, lines near its lower side end in the structure beneath; in the cartilages of the knee phantom
/// these are at most a ninth of all votes.
constexpr double kUniformFraction = 0.75;

using Offset = std::array<int, 3>;

/// One direction of each opposite pair to the 26 neighbours.
std::array<Offset, 13> line_directions() {
  std::array<Offset, 13> directions{};
  std::size_t count = 0;
  for (int k = -1; k <= 1; ++k)
    for (int j = -1; j <= 1; ++j)
      for (int i = -1; i <= 1; ++i)
        if (std::array{k, j, i} > std::array{0, 0, 0}) directions[count++] = {i, j, k};
  return directions;
}

/// Weights by label, for a small number of labels.
class Votes {
 public:
  void add(LabelId label, double weight) {
    const auto found = std::ranges::find(votes_, label, &std::pair<LabelId, double>::first);
    if (found != votes_.end())
      found->second += weight;
    else
      votes_.emplace_back(label, weight);
  }
  bool empty() const { return votes_.empty(); }
  /// Label with the greatest weight, the lowest label in a tie; 0 without votes.
  LabelId winner() const {
    std::pair<LabelId, double> best{0, 0};
    for (const auto& vote : votes_)
      if (vote.second > best.second || (vote.second == best.second && vote.first < best.first)) best = vote;
    return best.first;
  }
  double share_of(LabelId label) const {
    double all = 0, own = 0;
    for (const auto& [other, weight] : votes_) {
      all += weight;
      own += other == label ? weight : 0;
    }
    return all > 0 ? own / all : 0;
  }

 private:
  std::vector<std::pair<LabelId, double>> votes_;
};

/// Bounding box of all hidden voxels, padded by one voxel on every side, as a dense array.
class HiddenBox {
 public:
  HiddenBox(const Bricks<LabelId>& labels, const std::vector<bool>& hidden, const VoxelBox& box)
      : box_(box), size_{box.size[0] + 2, box.size[1] + 2, box.size[2] + 2} {
    strides_ = {1, size_[0], std::ptrdiff_t{size_[0]} * size_[1]};
    labels_.resize(static_cast<std::size_t>(strides_[2]) * static_cast<std::size_t>(size_[2]));
    number_.assign(labels_.size(), kVisible);
    std::size_t at = 0;
    for (int k = 0; k < size_[2]; ++k)
      for (int j = 0; j < size_[1]; ++j)
        for (int i = 0; i < size_[0]; ++i, ++at) {
          labels_[at] = labels.anywhere(box.first[0] + i - 1, box.first[1] + j - 1, box.first[2] + k - 1);
          if (!hidden[labels_[at]]) continue;
          number_[at] = static_cast<std::int32_t>(voxels_.size());
          voxels_.push_back(at);
        }
    votes_.resize(voxels_.size());
  }

  PatchOf<LabelId> filled() {
    vote();
    std::vector<bool> visited(voxels_.size());
    for (std::size_t n = 0; n < voxels_.size(); ++n)
      if (!visited[n]) fill(component_of(n, visited));
    PatchOf<LabelId> patch{box_, {}};
    patch.values.reserve(box_.voxel_count());
    for (int k = 0; k < box_.size[2]; ++k)
      for (int j = 0; j < box_.size[1]; ++j)
        for (int i = 0; i < box_.size[0]; ++i)
          patch.values.push_back(labels_[static_cast<std::size_t>(
              (i + 1) * strides_[0] + (j + 1) * strides_[1] + (k + 1) * strides_[2])]);
    return patch;
  }

 private:
  static constexpr std::int32_t kVisible = -1;
  using Component = std::vector<std::size_t>;  // indices into voxels_, ascending

  std::size_t step(std::size_t at, std::ptrdiff_t by) const {
    return static_cast<std::size_t>(static_cast<std::ptrdiff_t>(at) + by);
  }
  std::ptrdiff_t stride(const Offset& d) const {
    return d[0] * strides_[0] + d[1] * strides_[1] + d[2] * strides_[2];
  }
  bool is_hidden(std::size_t at) const { return number_[at] != kVisible; }

  // processes each line once, from its first voxel
  void vote() {
    for (const Offset& direction : line_directions()) {
      const std::ptrdiff_t by = stride(direction);
      for (const std::size_t first : voxels_) {
        const std::size_t before = step(first, -by);
        if (is_hidden(before) || labels_[before] == 0) continue;
        std::size_t after = first;
        double length = 0;
        for (; is_hidden(after); after = step(after, by)) ++length;
        if (labels_[after] != labels_[before]) continue;
        for (std::size_t at = first; at != after; at = step(at, by))
          votes_[static_cast<std::size_t>(number_[at])].add(labels_[before], 1 / length);
      }
    }
  }

  Component component_of(std::size_t first, std::vector<bool>& visited) const {
    Component component{first};
    visited[first] = true;
    for (std::size_t n = 0; n < component.size(); ++n)
      for (const Offset& direction : line_directions())
        for (const std::ptrdiff_t by : {stride(direction), -stride(direction)}) {
          const std::int32_t next = number_[step(voxels_[component[n]], by)];
          if (next == kVisible || visited[static_cast<std::size_t>(next)]) continue;
          visited[static_cast<std::size_t>(next)] = true;
          component.push_back(static_cast<std::size_t>(next));
        }
    std::ranges::sort(component);
    return component;
  }

  void fill(const Component& component) {
    Votes all, faces;
    for (const std::size_t n : component) {
      if (!votes_[n].empty()) all.add(votes_[n].winner(), 1);
      for (const std::ptrdiff_t stride : strides_)
        for (const std::ptrdiff_t by : {stride, -stride})
          if (const std::size_t other = step(voxels_[n], by); !is_hidden(other) && labels_[other] != 0)
            faces.add(labels_[other], 1);
    }
    // without a line that ends in one structure: the structure with the largest contact area
    const LabelId most = all.empty() ? faces.winner() : all.winner();
    if (all.empty() || all.share_of(most) >= kUniformFraction) {
      for (const std::size_t n : component) labels_[voxels_[n]] = most;
      return;
    }
    Component open;
    for (const std::size_t n : component) {
      labels_[voxels_[n]] = votes_[n].winner();
      if (votes_[n].empty()) open.push_back(n);
    }
    spread_into(open);
  }

  // layer by layer, so that the result does not depend on the order within a layer
  void spread_into(Component open) {
    while (!open.empty()) {
      std::vector<std::pair<std::size_t, LabelId>> layer;
      Component left;
      for (const std::size_t n : open) {
        Votes around;
        for (const std::ptrdiff_t stride : strides_)
          for (const std::ptrdiff_t by : {stride, -stride})
            if (const LabelId label = labels_[step(voxels_[n], by)]; label != 0) around.add(label, 1);
        if (around.empty())
          left.push_back(n);
        else
          layer.emplace_back(voxels_[n], around.winner());
      }
      if (layer.empty()) return;
      for (const auto& [at, label] : layer) labels_[at] = label;
      open = std::move(left);
    }
  }

  VoxelBox box_;
  std::array<int, 3> size_;
  std::array<std::ptrdiff_t, 3> strides_{};
  std::vector<LabelId> labels_;
  std::vector<std::int32_t> number_;  // index of a hidden voxel in voxels_
  std::vector<std::size_t> voxels_;   // hidden voxels, ascending
  std::vector<Votes> votes_;          // per hidden voxel
};

std::optional<VoxelBox> box_of(const Bricks<LabelId>& labels, const std::vector<bool>& hidden) {
  Offset first = labels.geometry().dims, last{-1, -1, -1};
  labels.for_each_piece([&](const RowPiece<LabelId>& piece) {
    for (int n = 0; n < piece.count; ++n) {
      if (!hidden[piece.voxels[n]]) {
        if (piece.uniform) return;
        continue;
      }
      const Offset at{piece.i + n, piece.j, piece.k};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        first[axis] = std::min(first[axis], at[axis]);
        last[axis] = std::max(last[axis], at[axis]);
      }
    }
  });
  if (last[0] < 0) return std::nullopt;
  VoxelBox box{first, {}};
  for (std::size_t axis = 0; axis < 3; ++axis) box.size[axis] = last[axis] - first[axis] + 1;
  return box;
}

}  // namespace

std::shared_ptr<const Bricks<LabelId>> redacted_labels(std::shared_ptr<const Bricks<LabelId>> labels,
                                                       const std::vector<bool>& hidden) {
  const auto box = box_of(*labels, hidden);
  if (!box) return labels;
  return std::make_shared<const Bricks<LabelId>>(labels->with(HiddenBox(*labels, hidden, *box).filled()));
}

}  // namespace palpate::server
