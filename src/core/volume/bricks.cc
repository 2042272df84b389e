#include "palpate/volume/bricks.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <unordered_map>
#include <unordered_set>

#include "palpate/base/for_each_index.h"
#include "palpate/base/hash.h"

namespace palpate {

namespace {

using L = BrickLayout;

std::uint64_t hash_at(std::uint64_t hash, std::size_t number) {
  hash_word(hash, number);
  return hash_finish(hash);
}

/// Index along an axis of the first voxel that a brick stores.
int first_stored(int brick) {
  return brick * L::kCells - L::kBorder - L::kBefore;
}

/// Half-open interval of voxel or brick indices along an axis: low ... high - 1.
struct Interval {
  int low, high;
  int size() const { return std::max(0, high - low); }
};

Interval common(const Interval& a, const Interval& b) {
  return {std::max(a.low, b.low), std::min(a.high, b.high)};
}

/// Intersection of the voxels that a brick stores with the box low ... high - 1.
std::array<Interval, 3> stored_of(const std::array<int, 3>& brick, const std::array<int, 3>& low,
                                  const std::array<int, 3>& high) {
  std::array<Interval, 3> part;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int first = first_stored(brick[axis]);
    part[axis] = common({first, first + L::kVoxels}, {low[axis], high[axis]});
  }
  return part;
}

/// Copies the intersection of a box of voxels with a brick into the brick.
/// @param from    the box's voxels, i fastest, beginning at `low`
/// @param stored  the brick's voxels
template <class T>
void write_into(const std::array<int, 3>& brick, const std::array<int, 3>& low,
                const std::array<int, 3>& high, const T* from, T* stored) {
  const auto [is, js, ks] = stored_of(brick, low, high);
  if (is.size() == 0) return;
  const std::ptrdiff_t row = high[0] - low[0], slice = row * (high[1] - low[1]);
  for (int k = ks.low; k < ks.high; ++k) {
    for (int j = js.low; j < js.high; ++j) {
      const T* source = from + (is.low - low[0]) + (j - low[1]) * row + (k - low[2]) * slice;
      T* to = stored + (is.low - first_stored(brick[0])) + (j - first_stored(brick[1])) * L::kRow +
              (k - first_stored(brick[2])) * L::kSlice;
      std::copy_n(source, is.size(), to);
    }
  }
}

/// Bricks that store at least one voxel of the interval.
Interval bricks_at(const Interval& voxels, int count) {
  const int first = voxels.low + L::kBorder - L::kAfter - L::kCells + 1;
  const int last = voxels.high - 1 + L::kBorder + L::kBefore;
  return {std::max(0, (first + L::kCells - 1) / L::kCells), std::min(count, last / L::kCells + 1)};
}

template <class T>
bool same_voxels(const T* a, const T* b) {
  return std::memcmp(a, b, L::kStored * sizeof(T)) == 0;
}

}  // namespace

template <class T>
typename Bricks<T>::Shared Bricks<T>::store(const Brick& brick) {
  constexpr std::size_t bytes = kStored * sizeof(T);
  const auto* const raw = reinterpret_cast<const unsigned char*>(brick.voxels());
  const bool uniform = std::memcmp(raw, raw + sizeof(T), bytes - sizeof(T)) == 0;
  if (uniform) {
    for (const Uniform& one : uniform_)
      if (std::memcmp(one.brick->voxels(), raw, sizeof(T)) == 0) return one.brick;
  }
  auto stored = std::make_shared<Brick>(brick);
  stored->uniform = uniform;
  stored->hash = kHashSeed;
  hash_bytes(stored->hash, raw, bytes);
  if (uniform) uniform_.push_back({stored});
  return stored;
}

template <class T>
void Bricks<T>::count_use(const Brick& brick) {
  if (!brick.uniform) return;
  for (Uniform& one : uniform_)
    if (one.brick.get() == &brick) ++one.count;
}

template <class T>
void Bricks<T>::discount_use(const Brick& brick) {
  if (brick.uniform)
    std::erase_if(uniform_, [&](Uniform& one) { return one.brick.get() == &brick && --one.count == 0; });
}

namespace {

// a degenerate grid is refused by check_grid() where a model is made of it
Transform<Voxel, Patient> voxel_from_patient(const GridGeometry& grid) {
  const Transform<Patient, Voxel> X_PatientVoxel = grid.X_PatientVoxel();
  const double determinant = X_PatientVoxel.linear().determinant();
  return std::isfinite(determinant) && determinant != 0 ? X_PatientVoxel.inverse()
                                                        : Transform<Voxel, Patient>();
}

}  // namespace

template <class T>
Bricks<T>::Bricks(const GridGeometry& grid, T outside, Unfilled)
    : geometry_(grid), X_VoxelPatient_(voxel_from_patient(grid)), outside_(outside) {
  std::size_t bricks = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    counts_[axis] = (grid.dims[axis] + 2 * kBorder - 1) / kCells + 1;
    bricks *= static_cast<std::size_t>(counts_[axis]);
  }
  table_.resize(bricks);
}

/// Builder that sets all bricks of a volume, in ascending order of their indices.
template <class T>
class Bricks<T>::Filling {
 public:
  explicit Filling(Bricks& bricks)
      : bricks_(bricks),
        pages_((bricks.table_.size() + kPage - 1) / kPage),
        brick_(std::make_unique<Brick>()) {}

  void put(Shared stored) {
    bricks_.count_use(*stored);
    bricks_.table_[number_] = stored->voxels();
    bricks_.hash_ += hash_at(stored->hash, number_);
    pages_[number_ / kPage][number_ % kPage] = std::move(stored);
    ++number_;
  }
  /// Appends a layer of bricks from the box low ... high - 1 of voxels; `outside` beyond the box.
  void put_layer(int c, const std::array<int, 3>& low, const std::array<int, 3>& high, const T* voxels) {
    for (int b = 0; b < bricks_.counts_[1]; ++b) {
      for (int a = 0; a < bricks_.counts_[0]; ++a) {
        std::fill_n(brick_->voxels(), kStored, bricks_.outside_);
        write_into({a, b, c}, low, high, voxels, brick_->voxels());
        const Shared stored = bricks_.store(*brick_);
        const auto [first, is_new] = made_.try_emplace(stored->hash, stored);
        put(!is_new && same_voxels(first->second->voxels(), stored->voxels()) ? first->second : stored);
      }
    }
  }
  /// Completes the volume after the last brick.
  void end() {
    PALPATE_CHECK(number_ == bricks_.table_.size());
    bricks_.pages_.reserve(pages_.size());
    for (Page& page : pages_) bricks_.pages_.push_back(std::make_shared<const Page>(std::move(page)));
  }

 private:
  Bricks& bricks_;
  std::vector<Page> pages_;
  std::size_t number_ = 0;
  std::unique_ptr<Brick> brick_;
  // Bricks by hash, to share equal ones: structures thinner than a brick, such as slices and rods, repeat.
  std::unordered_map<std::uint64_t, Shared> made_;
};

template <class T>
template <class BrickAt>
void Bricks<T>::fill(const BrickAt& brick_at) {
  Filling filling(*this);
  for (std::size_t number = 0; number < table_.size(); ++number) filling.put(brick_at(number));
  filling.end();
}

template <class T>
Bricks<T>::Bricks(const GridGeometry& grid, T value) : Bricks(grid, value, Unfilled{}) {
  const auto brick = std::make_unique<Brick>();
  std::fill_n(brick->voxels(), kStored, value);
  const Shared one = store(*brick);
  fill([&](std::size_t) { return one; });
}

template <class T>
Bricks<T>::Bricks(const GridGeometry& grid, const Volume<T>& voxels, int margin, T outside)
    : Bricks(grid, outside, Unfilled{}) {
  std::array<int, 3> low, high;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    PALPATE_CHECK(voxels.geometry().dims[axis] == grid.dims[axis] + 2 * margin && margin <= kBorder);
    low[axis] = -margin;
    high[axis] = grid.dims[axis] + margin;
  }
  Filling filling(*this);
  for (int c = 0; c < counts_[2]; ++c) filling.put_layer(c, low, high, voxels.voxels().data());
  filling.end();
}

template <class T>
Bricks<T> Bricks<T>::of_labels(const Bricks<LabelId>& labels, std::span<const T> value_of) {
  PALPATE_CHECK(value_of.size() > std::numeric_limits<LabelId>::max());
  Bricks values(labels.geometry(), value_of[labels.outside()], Unfilled{});
  const auto brick = std::make_unique<Brick>();
  std::unordered_map<const LabelId*, Shared> made;
  values.fill([&](std::size_t number) {
    const LabelId* const here = labels.brick(number);
    Shared& stored = made[here];
    if (stored == nullptr) {
      std::transform(here, here + kStored, brick->voxels(), [&](LabelId label) { return value_of[label]; });
      stored = values.store(*brick);
    }
    return stored;
  });
  return values;
}

template <class T>
Bricks<T> Bricks<T>::with(const PatchOf<T>& patch) const {
  PALPATE_CHECK(patch.values.size() == patch.box.voxel_count());
  Bricks now = *this;
  if (patch.values.empty()) return now;
  const std::array<int, 3>& low = patch.box.first;
  std::array<int, 3> high;
  std::array<Interval, 3> at;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    high[axis] = low[axis] + patch.box.size[axis];
    PALPATE_CHECK(low[axis] >= 0 && high[axis] <= geometry_.dims[axis]);
    at[axis] = bricks_at({low[axis], high[axis]}, counts_[axis]);
  }
  const auto brick = std::make_unique<Brick>();
  // pages copied by this version, by page index
  std::vector<std::shared_ptr<Page>> own(pages_.size());
  for (int c = at[2].low; c < at[2].high; ++c) {
    for (int b = at[1].low; b < at[1].high; ++b) {
      for (int a = at[0].low; a < at[0].high; ++a) {
        const auto number = static_cast<std::size_t>(a) +
                            static_cast<std::size_t>(counts_[0]) *
                                (static_cast<std::size_t>(b) +
                                 static_cast<std::size_t>(counts_[1]) * static_cast<std::size_t>(c));
        const Brick& was = *shared_brick(number);
        std::copy_n(was.voxels(), kStored, brick->voxels());
        write_into({a, b, c}, low, high, patch.values.data(), brick->voxels());
        if (same_voxels(brick->voxels(), was.voxels())) continue;
        std::shared_ptr<Page>& page = own[number / kPage];
        if (page == nullptr) page = std::make_shared<Page>(*pages_[number / kPage]);
        Shared& stored = (*page)[number % kPage];
        stored = now.store(*brick);
        now.count_use(*stored);
        now.discount_use(was);
        now.table_[number] = stored->voxels();
        now.hash_ += hash_at(stored->hash, number) - hash_at(was.hash, number);
      }
    }
  }
  for (std::size_t n = 0; n < own.size(); ++n)
    if (own[n] != nullptr) now.pages_[n] = std::move(own[n]);
  return now;
}

template <class T>
void Bricks<T>::copy_row(int i, int j, int k, int count, T* to) const {
  while (count > 0) {
    const int here = std::min(count, kCells - (i + kBorder) % kCells);
    std::copy_n(view().cell(i, j, k), here, to);
    i += here;
    to += here;
    count -= here;
  }
}

template <class T>
Volume<T> Bricks<T>::dense() const {
  Volume<T> volume(geometry_);
  if (volume.empty()) return volume;
  for (int k = 0; k < geometry_.dims[2]; ++k)
    for (int j = 0; j < geometry_.dims[1]; ++j) copy_row(0, j, k, geometry_.dims[0], &volume.at(0, j, k));
  return volume;
}

template <class T>
std::size_t Bricks<T>::bytes() const {
  const std::unordered_set<const T*> distinct(table_.begin(), table_.end());
  return distinct.size() * sizeof(Brick) + table_.size() * sizeof table_[0] + pages_.size() * sizeof(Page);
}

template <class T>
BricksBuilder<T>::BricksBuilder(const GridGeometry& grid, T outside)
    : bricks_(grid, outside, typename Bricks<T>::Unfilled{}),
      filling_(std::make_unique<typename Bricks<T>::Filling>(bricks_)) {}

template <class T>
BricksBuilder<T>::~BricksBuilder() = default;

template <class T>
void BricksBuilder<T>::add(int slices, const T* voxels) {
  const std::array<int, 3>& dims = bricks_.geometry().dims;
  const auto slice = static_cast<std::size_t>(dims[0]) * static_cast<std::size_t>(dims[1]);
  buffered_slices_.insert(buffered_slices_.end(), voxels, voxels + slice * static_cast<std::size_t>(slices));
  const int end = first_ + (slice == 0 ? 0 : static_cast<int>(buffered_slices_.size() / slice));
  PALPATE_CHECK(end <= dims[2]);
  for (; layer_ < bricks_.counts()[2]; ++layer_) {
    const int first = std::clamp(first_stored(layer_), 0, end);
    if (end < dims[2] && end < first_stored(layer_) + L::kVoxels) break;
    filling_->put_layer(layer_, {0, 0, first}, {dims[0], dims[1], end},
                        buffered_slices_.data() + slice * static_cast<std::size_t>(first - first_));
  }
  const int first_needed = std::clamp(first_stored(layer_), first_, end);
  buffered_slices_.erase(
      buffered_slices_.begin(),
      buffered_slices_.begin() + static_cast<std::ptrdiff_t>(slice) * (first_needed - first_));
  first_ = first_needed;
}

template <class T>
Bricks<T> BricksBuilder<T>::take() {
  // a grid without voxels has received no slice
  add(0, nullptr);
  filling_->end();
  return std::move(bricks_);
}

std::shared_ptr<const Bricks<LabelId>> label_bricks(const Volume<LabelId>& labels) {
  return std::make_shared<const Bricks<LabelId>>(labels, LabelId{0});
}

std::vector<std::size_t> label_counts(const Bricks<LabelId>& labels) {
  const int slices = labels.geometry().dims[2], workers = worker_count(0, slices);
  std::vector<std::vector<std::size_t>> of_worker(static_cast<std::size_t>(workers));
  for (std::vector<std::size_t>& counts : of_worker)
    counts.resize(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  for_each_index(slices, workers, [&](int worker, int k) {
    std::vector<std::size_t>& counts = of_worker[static_cast<std::size_t>(worker)];
    const auto count = [&](const RowPiece<LabelId>& piece) {
      if (piece.uniform)
        counts[*piece.voxels] += static_cast<std::size_t>(piece.count);
      else
        for (int i = 0; i < piece.count; ++i) ++counts[piece.voxels[i]];
    };
    for (int j = 0; j < labels.geometry().dims[1]; ++j) labels.for_each_piece(j, k, count);
    return true;
  });
  std::vector<std::size_t>& all = of_worker.front();
  for (std::size_t w = 1; w < of_worker.size(); ++w)
    for (std::size_t label = 0; label < all.size(); ++label) all[label] += of_worker[w][label];
  return std::move(all);
}

template class Bricks<std::uint8_t>;
template class Bricks<std::uint16_t>;
template class Bricks<std::int16_t>;
template class Bricks<float>;
template class BricksBuilder<std::uint8_t>;
template class BricksBuilder<std::uint16_t>;
template class BricksBuilder<std::int16_t>;
template class BricksBuilder<float>;

}  // namespace palpate
