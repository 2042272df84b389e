#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "palpate/volume/volume.h"

/// Voxels that change a little, often, while others read them.
namespace palpate {

/// A box of voxels: first ... first + size - 1 along i, j, k.
struct VoxelBox {
  std::array<int, 3> first{0, 0, 0}, size{0, 0, 0};
  bool operator==(const VoxelBox&) const = default;

  std::size_t voxel_count() const {
    std::size_t count = 1;
    for (const int n : size) count *= static_cast<std::size_t>(n);
    return count;
  }
};

/// New values in a box of a grid, i fastest.
template <class T>
struct PatchOf {
  VoxelBox box;
  std::vector<T> values;
};

/// How bricks cut a grid into pieces, the same for every type of voxel.
struct BrickLayout {
  /// A brick answers for so many cells along each axis; cell c lies between voxels c and c + 1.
  static constexpr int kCells = 16;
  /// It holds the voxels that a query reads around any of its cells, from one before the cell to two after
  /// it, so that a query reads one brick.
  static constexpr int kBefore = 1, kAfter = 2;
  static constexpr int kVoxels = kBefore + kCells + kAfter;
  static constexpr std::ptrdiff_t kRow = kVoxels, kSlice = kRow * kVoxels;
  static constexpr std::size_t kStored = static_cast<std::size_t>(kSlice) * kVoxels;
  /// So many more may be read before a brick's first voxel and after its last, so that whole vectors can be
  /// loaded along its rows. What stands there means nothing.
  static constexpr std::size_t kSpare = 16;
  /// From a voxel to those that it shares a face with, in its brick.
  static constexpr std::array<std::ptrdiff_t, 6> kFaces{1, -1, kRow, -kRow, kSlice, -kSlice};
  /// So many voxels around the grid can be read as if they were of it.
  static constexpr int kBorder = 4;
};

/// For whoever reads many places; valid as long as the Bricks are.
template <class T>
struct BrickView {
  const T* const* table;      ///< of bricks, along i fastest
  std::ptrdiff_t row, slice;  ///< of the table

  /// Voxel (i, j, k), from BrickLayout::kBorder before the grid to as many beyond it. Around it, from
  /// BrickLayout::kBefore before to kAfter after it along each axis, other voxels stand at steps of 1,
  /// BrickLayout::kRow and kSlice; none of them farther than the border.
  const T* cell(std::ptrdiff_t i, std::ptrdiff_t j, std::ptrdiff_t k) const {
    using L = BrickLayout;
    const auto a = static_cast<std::size_t>(i + L::kBorder), b = static_cast<std::size_t>(j + L::kBorder),
               c = static_cast<std::size_t>(k + L::kBorder);
    constexpr std::size_t n = L::kCells;
    const auto place = [](std::size_t x) { return static_cast<std::ptrdiff_t>(x % n) + L::kBefore; };
    const T* const brick =
        table[static_cast<std::ptrdiff_t>(a / n) + static_cast<std::ptrdiff_t>(b / n) * row +
              static_cast<std::ptrdiff_t>(c / n) * slice];
    return brick + (place(a) + place(b) * L::kRow + place(c) * L::kSlice);
  }
};

/// Part of a row of the grid that one brick answers for.
template <class T>
struct RowPiece {
  int i, j, k;      ///< its first voxel
  int count;        ///< 1 ... BrickLayout::kCells
  const T* voxels;  ///< others stand around them as around a BrickView's cell
  bool uniform;     ///< these and all within BrickLayout::kBefore and kAfter of them have one value
};

template <class T>
class BricksBySlices;

/// Voxels on a grid, in bricks that versions share. Never edited: `with` makes a version that differs in a
/// box and holds every other brick together with the one it was made from. A brick all of whose voxels are
/// equal is held once, however often it occurs, and so is any that occurs again in the volume that bricks are
/// made of; each costs 1.67 times its voxels, for what it holds of its neighbours. Reading allocates, locks
/// and throws nothing. The last version that holds a brick frees it, on the thread that drops the version.
///
/// For T of std::uint8_t, std::uint16_t, std::int16_t and float.
template <class T>
class Bricks : public BrickLayout {
 public:
  /// Nothing but border.
  Bricks() : Bricks(Volume<T>(GridGeometry{}), T{}) {}
  /// The voxels of a volume, `outside` around it.
  Bricks(const Volume<T>& volume, T outside) : Bricks(volume.geometry(), volume, 0, outside) {}
  /// @param voxels  of the grid with `margin` more on every side; only their number counts
  /// @param margin  at most kBorder
  Bricks(const GridGeometry& grid, const Volume<T>& voxels, int margin, T outside);
  /// One value everywhere, outside the grid too.
  Bricks(const GridGeometry& grid, T value);

  /// What a table says of each of a volume's labels; costs what the labels' distinct bricks do.
  /// @param value_of  by label, for all 65 536
  static Bricks of_labels(const Bricks<LabelId>& labels, std::span<const T> value_of);

  /// The same but for a box, which must lie in the grid. Costs what the box's bricks do, and 8 bytes and a
  /// little for each brick of the grid.
  Bricks with(const PatchOf<T>& patch) const;

  const GridGeometry& geometry() const { return geometry_; }
  T outside() const { return outside_; }
  BrickView<T> view() const {
    return {table_.data(), counts_[0], static_cast<std::ptrdiff_t>(counts_[0]) * counts_[1]};
  }
  /// Any voxel from kBorder before the grid to kBorder beyond it, on every axis.
  T at(int i, int j, int k) const { return *view().cell(i, j, k); }
  /// Any voxel at all: `outside` beyond the grid.
  T anywhere(int i, int j, int k) const { return geometry_.contains(i, j, k) ? at(i, j, k) : outside_; }
  /// Voxels i ... i + count - 1 of a row of the grid or its border.
  void copy_row(int i, int j, int k, int count, T* to) const;
  /// Calls visit(RowPiece) for the pieces of row (j, k) of the grid, or of all its rows, i fastest, then j.
  template <class Visit>
  void for_each_piece(int j, int k, const Visit& visit) const {
    for (int i = 0; i < geometry_.dims[0];) {
      const int count = std::min(geometry_.dims[0] - i, kCells - (i + kBorder) % kCells);
      visit(RowPiece<T>{i, j, k, count, view().cell(i, j, k), is_uniform(brick_of(i, j, k))});
      i += count;
    }
  }
  template <class Visit>
  void for_each_piece(const Visit& visit) const {
    for (int k = 0; k < geometry_.dims[2]; ++k)
      for (int j = 0; j < geometry_.dims[1]; ++j) for_each_piece(j, k, visit);
  }
  /// A copy of the grid's voxels.
  Volume<T> dense() const;

  /// Bricks along i, j, k. Brick (a, b, c) answers for kCells cells from kCells * a - kBorder on along i, and
  /// so on; its number is a + counts[0] * (b + counts[1] * c).
  const std::array<int, 3>& counts() const { return counts_; }
  /// The stored voxels of a brick, kStored of them.
  const T* brick(std::size_t number) const { return table_[number]; }
  bool is_uniform(std::size_t number) const { return held(number)->uniform; }

  /// The same for equal voxels on as many along each axis with the same `outside`, however they came to be. A
  /// grid that has some more of `outside` at its end may have the same one.
  std::uint64_t content_hash() const { return hash_; }
  /// What this version would take if it stood alone.
  std::size_t bytes() const;

 private:
  struct Brick {
    T* voxels() { return with_spare.data() + kSpare; }
    const T* voxels() const { return with_spare.data() + kSpare; }

    std::uint64_t hash = 0;
    bool uniform = false;
    std::array<T, kSpare + kStored + kSpare> with_spare;
  };
  using Shared = std::shared_ptr<const Brick>;
  // so many bricks are owned together: a version copies its pages, not their bricks
  static constexpr std::size_t kPage = 64;
  using Page = std::array<Shared, kPage>;

  // a brick of one value, and at how many places it stands
  struct Uniform {
    Shared brick;
    std::size_t places = 0;
  };

  friend BricksBySlices<T>;
  class Filling;
  struct Unfilled {};
  /// As many bricks as the grid takes, none of them there yet.
  Bricks(const GridGeometry& grid, T outside, Unfilled);

  std::size_t brick_of(int i, int j, int k) const {
    const auto along = [](int voxel) { return static_cast<std::size_t>((voxel + kBorder) / kCells); };
    return along(i) + static_cast<std::size_t>(counts_[0]) *
                          (along(j) + static_cast<std::size_t>(counts_[1]) * along(k));
  }
  const Shared& held(std::size_t number) const { return (*pages_[number / kPage])[number % kPage]; }
  /// A brick, or the one that is there already for its value where it holds but one.
  Shared keep(const Brick& brick);
  /// Says that a brick stands at one more place, or at one less.
  void count_place(const Brick& brick);
  void discount_place(const Brick& brick);
  /// Bricks for all places. @param brick_at  shared brick of a number, to be called in their order
  template <class BrickAt>
  void fill(const BrickAt& brick_at);

  GridGeometry geometry_;
  T outside_;
  std::array<int, 3> counts_;
  std::vector<const T*> table_;
  std::vector<std::shared_ptr<const Page>> pages_;
  std::vector<Uniform> uniform_;
  std::uint64_t hash_ = 0;  ///< sum of the bricks' hashes, each mixed with its number
};

/// Bricks of voxels that come slice after slice, for whoever has no room for all of them at a time: a layer
/// of bricks is made as soon as its slices are there. The same bit for bit as of a whole volume.
template <class T>
class BricksBySlices {
 public:
  BricksBySlices(const GridGeometry& grid, T outside);
  ~BricksBySlices();

  /// The next slices of the grid. @param voxels  all of them, i fastest
  void add(int slices, const T* voxels);
  /// After the last slice.
  Bricks<T> take();

 private:
  Bricks<T> bricks_;
  std::unique_ptr<typename Bricks<T>::Filling> filling_;
  int layer_ = 0;  ///< the next one to be made
  int first_ = 0;  ///< slice that is held
  std::vector<T> held_;
};

/// The labels in bricks, background around them.
std::shared_ptr<const Bricks<LabelId>> label_bricks(const Volume<LabelId>& labels);

/// How many voxels of the grid have each label, by label.
std::vector<std::size_t> label_counts(const Bricks<LabelId>& labels);

extern template class Bricks<std::uint8_t>;
extern template class Bricks<std::uint16_t>;
extern template class Bricks<std::int16_t>;
extern template class Bricks<float>;
extern template class BricksBySlices<std::uint8_t>;
extern template class BricksBySlices<std::uint16_t>;
extern template class BricksBySlices<std::int16_t>;
extern template class BricksBySlices<float>;

/// A box of the grid beyond which both have the same voxels, from the bricks that they do not share; of size
/// 0 where they share all. For two versions of one volume.
template <class T>
VoxelBox box_of_changes(const Bricks<T>& one, const Bricks<T>& other) {
  using L = BrickLayout;
  PALPATE_CHECK(one.geometry().dims == other.geometry().dims);
  const std::array<int, 3>& dims = one.geometry().dims;
  const std::array<int, 3>& counts = one.counts();
  std::array<int, 3> first = dims, end{0, 0, 0};
  std::size_t number = 0;
  for (int c = 0; c < counts[2]; ++c)
    for (int b = 0; b < counts[1]; ++b)
      for (int a = 0; a < counts[0]; ++a, ++number) {
        if (one.brick(number) == other.brick(number)) continue;
        const std::array<int, 3> at{a, b, c};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const int low = L::kCells * at[axis] - L::kBorder;
          first[axis] = std::min(first[axis], std::max(0, low));
          end[axis] = std::max(end[axis], std::min(dims[axis], low + L::kCells));
        }
      }
  VoxelBox box;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (end[axis] <= first[axis]) return {};
    box.first[axis] = first[axis];
    box.size[axis] = end[axis] - first[axis];
  }
  return box;
}

}  // namespace palpate
