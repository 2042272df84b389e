#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

/// Distances from tiles of voxels to a net's triangles. Each function dispatches to the best SIMD target of
/// the machine; bit-identical for all. Lengths in mm.
namespace palpate::internal {

/// Flat cylinder that bounds some of a net's triangles: within `along` of the centre along the normal, and
/// within `across` perpendicular to it. The centre is a point on one of the triangles.
struct NetDisc {
  float middle[3], along, normal[3], across;
};

/// Adjacent triangles and their bound.
struct NetPart {
  NetDisc disc;
  std::uint32_t first = 0, last = 0;
};

/// A triangle with precomputed products for distance queries.
struct NetTriangle {
  NetDisc disc;  ///< Bound of the triangle, with the normal of its plane
  float corner[3], ab[3], ac[3];
  float ab_ab, ab_ac, ac_ac;
  float per_ab, per_ac, per_bc;  ///< 1 / squared length of an edge; 0 for a degenerate edge
  float area;                    ///< Squared area of the parallelogram; -1 for a degenerate triangle
};

/// Discs of candidate parts, in structure-of-arrays layout.
struct NearParts {
  /// Allocates capacity for `largest` parts and one vector of padding.
  void make_room(std::size_t largest);
  /// Appends a part; requires capacity.
  void add(const NetDisc& disc, std::uint32_t its_part);
  /// Moves the part that select_near() found nearest to the centre of its ball to the front.
  void move_nearest_first();

  std::size_t count = 0;
  /// Components in the order of NetDisc, and the squared distance found by select_near().
  std::array<std::vector<float>, 9> number;
  std::vector<std::int32_t> part;
};
/// Pointers to the arrays of NearParts.
struct NearPartRows {
  explicit NearPartRows(NearParts& parts);

  float* number[9];
  std::int32_t* part;
  std::size_t count;
};

/// Ball that contains some voxels.
struct VoxelsBall {
  float centre[3], radius;
};
/// Copies those parts whose triangles may be nearest to a point in the ball, at a distance of at most
/// reach_mm.
void select_near(NearParts& all, const VoxelsBall& ball, float reach_mm, NearParts& selected);

/// Size of a tile: voxels whose distances are computed together.
inline constexpr int kTileWidth = 4, kTileHeight = 2, kTileVoxels = kTileWidth * kTileHeight;
struct NetTile {
  float x[kTileVoxels], y[kTileVoxels], z;
  float squared[kTileVoxels];  ///< Squared distance to the nearest triangle; only ever decreased
};
/// Lowers the tile's squared distances to those of the candidate parts' triangles.
void measure_tile(const NetPart* parts, const NetTriangle* triangles, const NearParts& near, NetTile& tile);

}  // namespace palpate::internal
