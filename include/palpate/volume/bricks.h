#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "palpate/volume/volume.h"

/// Persistent (copy-on-write) voxel volumes: small, frequent edits while other threads read older versions.
namespace palpate {

/// Box of voxels: first ... first + size - 1 along i, j, k.
struct VoxelBox {
  std::array<int, 3> first{0, 0, 0}, size{0, 0, 0};
  bool operator==(const VoxelBox&) const = default;

  std::size_t voxel_count() const {
    std::size_t count = 1;
    for (const int n : size) count *= static_cast<std::size_t>(n);
    return count;
  }
};

/// New values for a box of a grid, i fastest.
template <class T>
struct PatchOf {
  VoxelBox box;
  std::vector<T> values;
};

/// Division of a grid into bricks, the same for every voxel type.
struct BrickLayout {
  /// Cells per brick along each axis; cell c lies between voxels c and c + 1.
  static constexpr int kCells = 16;
  /// Halo of a brick: it also stores the voxels that a query reads around any of its cells, from one before
  /// the cell to two after it, so that a query reads a single brick.
  static constexpr int kBefore = 1, kAfter = 2;
  static constexpr int kVoxels = kBefore + kCells + kAfter;
  static constexpr std::ptrdiff_t kRow = kVoxels, kSlice = kRow * kVoxels;
  static constexpr std::size_t kStored = static_cast<std::size_t>(kSlice) * kVoxels;
  /// Elements that may be read before a brick's first voxel and after its last, so that whole SIMD vectors
  /// can be loaded along its rows. Their values are undefined.
  static constexpr std::size_t kSpare = 16;
  /// Offsets within a brick from a voxel to its six face neighbours.
  static constexpr std::array<std::ptrdiff_t, 6> kFaces{1, -1, kRow, -kRow, kSlice, -kSlice};
  /// Width of the border around the grid whose voxels can be read like those of the grid.
  static constexpr int kBorder = 4;
};

/// Read access without reference counting, for code that reads many voxels; valid as long as the Bricks
/// object.
template <class T>
struct BrickView {
  const T* const* table;      ///< Pointers to the bricks' voxels, i fastest.
  std::ptrdiff_t row, slice;  ///< Strides of the table.

  /// Pointer to voxel (i, j, k), at most BrickLayout::kBorder outside the grid. Its neighbours, from
  /// BrickLayout::kBefore before it to kAfter after it along each axis and within the border, are at strides
  /// of 1, BrickLayout::kRow and kSlice.
  const T* cell(std::ptrdiff_t i, std::ptrdiff_t j, std::ptrdiff_t k) const {
    using L = BrickLayout;
    const auto a = static_cast<std::size_t>(i + L::kBorder), b = static_cast<std::size_t>(j + L::kBorder),
               c = static_cast<std::size_t>(k + L::kBorder);
    constexpr std::size_t n = L::kCells;
    const auto offset_of = [](std::size_t x) { return static_cast<std::ptrdiff_t>(x % n) + L::kBefore; };
    const T* const brick =
        table[static_cast<std::ptrdiff_t>(a / n) + static_cast<std::ptrdiff_t>(b / n) * row +
              static_cast<std::ptrdiff_t>(c / n) * slice];
    return brick + (offset_of(a) + offset_of(b) * L::kRow + offset_of(c) * L::kSlice);
  }
};

/// Section of a row of the grid within one brick.
template <class T>
struct RowPiece {
  int i, j, k;      ///< Its first voxel.
  int count;        ///< Number of voxels, 1 ... BrickLayout::kCells.
  const T* voxels;  ///< The neighbours can be read as around a BrickView's cell.
  bool uniform;     ///< These and all voxels within BrickLayout::kBefore and kAfter of them are equal.
};

template <class T>
class BricksBuilder;

/// Voxels on a grid, in bricks that versions share. Immutable: `with` makes a version that differs in a box
/// and shares every other brick with the version it was made from. A brick of a single value is stored once
/// per version, and repeated bricks are stored once when the volume is built. Each brick takes 1.67 times the
/// memory of its own voxels because of its halo. Reading does not allocate, lock or throw. A brick is freed
/// by the last version that holds it, on the thread that releases that version.
///
/// T is std::uint8_t, std::uint16_t, std::int16_t or float.
template <class T>
class Bricks : public BrickLayout {
 public:
  /// Empty grid with its border.
  Bricks() : Bricks(Volume<T>(GridGeometry{}), T{}) {}
  /// Voxels of a volume, `outside` around it.
  Bricks(const Volume<T>& volume, T outside) : Bricks(volume.geometry(), volume, 0, outside) {}
  /// @param grid     geometry without the margin
  /// @param voxels   values on `grid` extended by `margin` voxels on every side; of its geometry only the
  ///                 dimensions are used
  /// @param margin   0 ... kBorder
  /// @param outside  value beyond the margin
  Bricks(const GridGeometry& grid, const Volume<T>& voxels, int margin, T outside);
  /// One value everywhere, outside the grid too.
  Bricks(const GridGeometry& grid, T value);

  /// Applies a table to each voxel of a label volume; takes time proportional to the number of distinct
  /// bricks.
  /// @param value_of  value of each label; must cover all 65 536
  static Bricks of_labels(const Bricks<LabelId>& labels, std::span<const T> value_of);

  /// Version with new values in a box, which must lie within the grid. Costs the copies of the box's bricks,
  /// plus 8 bytes and a little for each brick of the grid.
  Bricks with(const PatchOf<T>& patch) const;

  const GridGeometry& geometry() const { return geometry_; }
  /// Inverse of GridGeometry::X_PatientVoxel(), computed once.
  const Transform<Voxel, Patient>& X_VoxelPatient() const { return X_VoxelPatient_; }
  T outside() const { return outside_; }
  BrickView<T> view() const {
    return {table_.data(), counts_[0], static_cast<std::ptrdiff_t>(counts_[0]) * counts_[1]};
  }
  /// Voxel (i, j, k), at most kBorder outside the grid along each axis.
  T at(int i, int j, int k) const { return *view().cell(i, j, k); }
  /// Voxel at any index: `outside` beyond the grid.
  T anywhere(int i, int j, int k) const { return geometry_.contains(i, j, k) ? at(i, j, k) : outside_; }
  /// Copies voxels i ... i + count - 1 of a row of the grid or its border.
  void copy_row(int i, int j, int k, int count, T* to) const;
  /// Calls visit(RowPiece) for the pieces of row (j, k) of the grid, or of all rows, i fastest, then j.
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
  /// Copy of the grid's voxels as a plain volume.
  Volume<T> dense() const;

  /// Number of bricks along i, j, k. Brick (a, b, c) covers kCells cells from kCells * a - kBorder on along
  /// i, and analogously along j and k; its index is a + counts[0] * (b + counts[1] * c).
  const std::array<int, 3>& counts() const { return counts_; }
  /// The kStored voxels of a brick.
  const T* brick(std::size_t number) const { return table_[number]; }
  bool is_uniform(std::size_t number) const { return shared_brick(number)->uniform; }

  /// Hash of the voxel values: equal for equal voxels on grids of equal dimensions with the same `outside`,
  /// regardless of the edits that led to them. Grids that differ only by additional voxels of value `outside`
  /// at their end may have equal hashes.
  std::uint64_t content_hash() const { return hash_; }
  /// Memory of this version if it shared nothing with others; bytes.
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
  // Bricks per page. Pages are reference counted as a whole: a new version copies pointers to pages, not to
  // bricks.
  static constexpr std::size_t kPage = 64;
  using Page = std::array<Shared, kPage>;

  // A brick of a single value and the number of its positions in the table.
  struct Uniform {
    Shared brick;
    std::size_t count = 0;
  };

  friend BricksBuilder<T>;
  class Filling;
  struct Unfilled {};
  /// Sizes the table for the grid; all bricks are still null.
  Bricks(const GridGeometry& grid, T outside, Unfilled);

  std::size_t brick_of(int i, int j, int k) const {
    const auto along = [](int voxel) { return static_cast<std::size_t>((voxel + kBorder) / kCells); };
    return along(i) + static_cast<std::size_t>(counts_[0]) *
                          (along(j) + static_cast<std::size_t>(counts_[1]) * along(k));
  }
  const Shared& shared_brick(std::size_t number) const { return (*pages_[number / kPage])[number % kPage]; }
  /// Shared copy of a brick; if it is uniform, the existing brick of that value.
  Shared store(const Brick& brick);
  /// Adds or removes one position of a uniform brick.
  void count_use(const Brick& brick);
  void discount_use(const Brick& brick);
  /// Sets all bricks.
  /// @param brick_at  returns the shared brick of an index; called in ascending order
  template <class BrickAt>
  void fill(const BrickAt& brick_at);

  GridGeometry geometry_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  T outside_;
  std::array<int, 3> counts_;
  std::vector<const T*> table_;
  std::vector<std::shared_ptr<const Page>> pages_;
  std::vector<Uniform> uniform_;
  std::uint64_t hash_ = 0;  ///< Sum of the bricks' hashes, each mixed with its index.
};

/// Builds Bricks from slices in order, without holding the whole volume: a layer of bricks is built as soon
/// as its slices have arrived. The result is bit-identical to one built from the whole volume.
template <class T>
class BricksBuilder {
 public:
  BricksBuilder(const GridGeometry& grid, T outside);
  ~BricksBuilder();

  /// Appends slices.
  /// @param voxels  all voxels of these slices, i fastest
  void add(int slices, const T* voxels);
  /// Completed volume, after the last slice.
  Bricks<T> take();

 private:
  Bricks<T> bricks_;
  std::unique_ptr<typename Bricks<T>::Filling> filling_;
  int layer_ = 0;  ///< Index of the next layer to build.
  int first_ = 0;  ///< First slice stored in buffered_slices_.
  std::vector<T> buffered_slices_;
};

/// Bricks of a label volume, surrounded by background.
std::shared_ptr<const Bricks<LabelId>> label_bricks(const Volume<LabelId>& labels);

/// Number of voxels of each label, indexed by label.
std::vector<std::size_t> label_counts(const Bricks<LabelId>& labels);

extern template class Bricks<std::uint8_t>;
extern template class Bricks<std::uint16_t>;
extern template class Bricks<std::int16_t>;
extern template class Bricks<float>;
extern template class BricksBuilder<std::uint8_t>;
extern template class BricksBuilder<std::uint16_t>;
extern template class BricksBuilder<std::int16_t>;
extern template class BricksBuilder<float>;

/// Bounding box of the voxels that may differ between two versions of one volume, from the bricks that they
/// do not share; size 0 if they share all bricks.
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
