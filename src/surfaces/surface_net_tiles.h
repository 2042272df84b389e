#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

/// The distance to a net's triangles, several at a time. Each function picks the best SIMD target of the
/// machine; bits are the same for every one. Lengths in mm.
namespace palpate::internal {

/// A flat round box that holds some of a net's triangles: no farther than `along` from the middle along the
/// normal, and `across` beside it. The middle is a place on one of the triangles.
struct NetDisc {
  float middle[3], along, normal[3], across;
};

/// Triangles that stand beside each other.
struct NetPart {
  NetDisc disc;
  std::uint32_t first = 0, last = 0;
};

struct NetTriangle {
  NetDisc disc;  ///< its own: the normal is that of its plane
  float corner[3], ab[3], ac[3];
  float ab_ab, ab_ac, ac_ac;
  float per_ab, per_ac, per_bc;  ///< 1 / the square of an edge's length; 0 where it has none
  float area;                    ///< squared, of the parallelogram; -1 where there is none
};

/// Discs of parts, each number of all of them side by side.
struct NearParts {
  /// Room for that many, and for a vector beyond.
  void make_room(std::size_t most);
  /// There is room.
  void add(const NetDisc& disc, std::uint32_t its_part);
  /// The one that keep_near() found nearest to the middle of its ball.
  void put_nearest_first();

  std::size_t count = 0;
  /// As they stand in a NetDisc, and the square of how far keep_near() found it.
  std::array<std::vector<float>, 9> number;
  std::vector<std::int32_t> part;
};
/// Where they stand.
struct NearPartRows {
  explicit NearPartRows(NearParts& parts);

  float* number[9];
  std::int32_t* part;
  std::size_t count;
};

/// A ball in which some voxels are.
struct VoxelsBall {
  float centre[3], radius;
};
/// Of some parts those in which triangles may be nearest to a place in the ball, and at most reach_mm from
/// it.
void keep_near(NearParts& all, const VoxelsBall& ball, float reach_mm, NearParts& kept);

/// Voxels whose distance is found together.
inline constexpr int kTileWidth = 4, kTileHeight = 2, kTileVoxels = kTileWidth * kTileHeight;
struct NetTile {
  float x[kTileVoxels], y[kTileVoxels], z;
  float squared[kTileVoxels];  ///< of the distance to the nearest triangle, where it is less than before
};
void measure_tile(const NetPart* parts, const NetTriangle* triangles, const NearParts& near, NetTile& tile);

}  // namespace palpate::internal
