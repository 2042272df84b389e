#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/volume.h"

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
  /// Voxels i ... i + count - 1 of a row of the grid or its border.
  void copy_row(int i, int j, int k, int count, T* to) const;
  /// A copy of the grid's voxels.
  Volume<T> dense() const;

  /// Bricks along i, j, k. Brick (a, b, c) answers for kCells cells from kCells * a - kBorder on along i, and
  /// so on; its number is a + counts[0] * (b + counts[1] * c).
  const std::array<int, 3>& counts() const { return counts_; }
  /// The stored voxels of a brick, kStored of them.
  const T* brick(std::size_t number) const { return table_[number]; }
  bool is_uniform(std::size_t number) const { return held(number)->uniform; }

  /// The same for equal voxels on as many along each axis with the same `outside`, however they came to be.
  std::uint64_t content_hash() const { return hash_; }
  /// What this version would take if it stood alone.
  std::size_t bytes() const;

 private:
  struct Brick {
    std::uint64_t hash = 0;
    bool uniform = false;
    std::array<T, kStored> voxels;
  };
  using Shared = std::shared_ptr<const Brick>;
  // so many bricks are owned together: a version copies its pages, not their bricks
  static constexpr std::size_t kPage = 64;
  using Page = std::array<Shared, kPage>;

  const Shared& held(std::size_t number) const { return (*pages_[number / kPage])[number % kPage]; }
  /// A brick, or the one that is there already for its value where it holds but one.
  Shared keep(const Brick& brick);
  // sets the counts; how many bricks that is
  std::size_t count_bricks();

  GridGeometry geometry_;
  T outside_;
  std::array<int, 3> counts_;
  std::vector<const T*> table_;
  std::vector<std::shared_ptr<const Page>> pages_;
  std::vector<Shared> uniform_;  ///< of one value each, that are or were in use
  std::uint64_t hash_ = 0;       ///< sum of the bricks' hashes, each mixed with its number
};

extern template class Bricks<std::uint8_t>;
extern template class Bricks<std::uint16_t>;
extern template class Bricks<std::int16_t>;
extern template class Bricks<float>;

}  // namespace palpate
