#include "surfaces/surface_net_tiles.h"

#include <algorithm>
#include <array>
#include <bit>
#include <utility>

// Compiled once per target by foreach_target.h, see gaussian_rows.cc.

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "surfaces/surface_net_tiles.cc"
#include <hwy/foreach_target.h>
// must follow foreach_target.h
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace palpate::internal::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, kTileVoxels>;
using Floats = hn::Vec<Tag>;

struct Vec3s {
  Floats x, y, z;
};

HWY_INLINE Floats dot(const Vec3s& a, const Vec3s& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
HWY_INLINE Vec3s difference(const Vec3s& a, const Vec3s& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}
HWY_INLINE Vec3s broadcast(const float* positions) {
  const Tag d;
  return {hn::Set(d, positions[0]), hn::Set(d, positions[1]), hn::Set(d, positions[2])};
}

/// Squared lower bound of the distance to a disc from a point `up` above its plane and at `from` relative to
/// its centre.
HWY_INLINE Floats apart_squared(const Vec3s& from, Floats up, Floats along, Floats across) {
  const auto zero = hn::Zero(Tag());
  const auto beside = hn::Sqrt(hn::Max(zero, hn::Sub(dot(from, from), hn::Mul(up, up))));
  const auto out = hn::Max(zero, hn::Sub(beside, across));
  const auto above = hn::Max(zero, hn::Sub(hn::Abs(up), along));
  return hn::Add(hn::Mul(out, out), hn::Mul(above, above));
}

std::size_t filter_parts(const NearPartRows& in, const VoxelsBall& ball, float reach_mm,
                         const NearPartRows& out) {
  const Tag d;
  const std::size_t lanes = hn::Lanes(d);
  const Vec3s centre = broadcast(ball.centre);

  // lower bound of the distance to each part, and distance to the nearest centre
  auto nearest = hn::Set(d, 1e30f);
  for (std::size_t n = 0; n < in.count; n += lanes) {
    const Vec3s middle{hn::LoadU(d, in.number[0] + n), hn::LoadU(d, in.number[1] + n),
                       hn::LoadU(d, in.number[2] + n)};
    const Vec3s normal{hn::LoadU(d, in.number[4] + n), hn::LoadU(d, in.number[5] + n),
                       hn::LoadU(d, in.number[6] + n)};
    const Vec3s from = difference(centre, middle);
    const auto apart = apart_squared(from, dot(from, normal), hn::LoadU(d, in.number[3] + n),
                                     hn::LoadU(d, in.number[7] + n));
    hn::StoreU(apart, d, in.number[8] + n);
    const auto there = hn::FirstN(d, in.count - n);
    nearest = hn::Min(nearest, hn::IfThenElse(there, dot(from, from), nearest));
  }
  const auto to_one = hn::Sqrt(hn::MinOfLanes(d, nearest));
  const auto radius = hn::Set(d, ball.radius);
  const auto most =
      hn::Add(hn::Min(hn::Add(to_one, radius), hn::Set(d, reach_mm)), hn::Add(radius, hn::Set(d, 1e-3f)));
  const auto limit = hn::Mul(most, most);

  static_assert(kTileVoxels <= 8, "a byte holds the bits of a vector");
  std::size_t retained = 0;
  for (std::size_t n = 0; n < in.count; n += lanes) {
    const auto there = hn::FirstN(d, in.count - n);
    const auto near = hn::And(there, hn::Le(hn::LoadU(d, in.number[8] + n), limit));
    // element by element: for 8 floats, Highway's Compress makes g++ copy a table of 2 kB to the stack at
    // every call
    std::array<std::uint8_t, 8> bits{};
    hn::StoreMaskBits(d, near, bits.data());
    for (unsigned left = bits[0]; left != 0; left &= left - 1) {
      const std::size_t from = n + static_cast<unsigned>(std::countr_zero(left));
      for (int m = 0; m < 9; ++m) out.number[m][retained] = in.number[m][from];
      out.part[retained++] = in.part[from];
    }
  }
  return retained;
}

/// Squared distance to a triangle; `up` is the height above its plane. If the projection is inside, the
/// distance to the plane, else to the nearest of the three edges.
HWY_INLINE Floats squared_distance(const NetTriangle& t, const Vec3s& p, Floats up) {
  const Tag d;
  const auto zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  const Vec3s ap = difference(p, broadcast(t.corner)), ab = broadcast(t.ab), ac = broadcast(t.ac),
              bc = difference(ac, ab);
  const auto along_ab = dot(ab, ap), along_ac = dot(ac, ap);
  const auto ab_ab = hn::Set(d, t.ab_ab), ab_ac = hn::Set(d, t.ab_ac), ac_ac = hn::Set(d, t.ac_ac);
  const auto to_edge = [&](const Vec3s& from, const Vec3s& edge, Floats along, float per) HWY_ATTR {
    const auto part = hn::Max(zero, hn::Min(one, hn::Mul(along, hn::Set(d, per))));
    const Vec3s off = difference(from, {hn::Mul(part, edge.x), hn::Mul(part, edge.y), hn::Mul(part, edge.z)});
    return dot(off, off);
  };
  const auto along_bc = hn::Sub(hn::Sub(along_ac, along_ab), hn::Sub(ab_ac, ab_ab));
  const auto beside =
      hn::Min(hn::Min(to_edge(ap, ab, along_ab, t.per_ab), to_edge(ap, ac, along_ac, t.per_ac)),
              to_edge(difference(ap, ab), bc, along_bc, t.per_bc));
  const auto v = hn::Sub(hn::Mul(ac_ac, along_ab), hn::Mul(ab_ac, along_ac));
  const auto w = hn::Sub(hn::Mul(ab_ab, along_ac), hn::Mul(ab_ac, along_ab));
  const auto inside = hn::And(hn::Ge(hn::Min(v, w), zero), hn::Le(hn::Add(v, w), hn::Set(d, t.area)));
  return hn::IfThenElse(inside, hn::Mul(up, up), beside);
}

void measure(const NetPart* parts, const NetTriangle* triangles, const std::int32_t* near, std::size_t count,
             NetTile& tile) {
  const Tag d;
  for (std::size_t x = 0; x < kTileVoxels; x += hn::Lanes(d)) {
    const Vec3s p{hn::LoadU(d, tile.x + x), hn::LoadU(d, tile.y + x), hn::Set(d, tile.z)};
    auto best = hn::LoadU(d, tile.squared + x);
    const auto may_be_nearer = [&](const NetDisc& disc, Floats& up) HWY_ATTR {
      const Vec3s from = difference(p, broadcast(disc.middle));
      up = dot(from, broadcast(disc.normal));
      const auto apart = apart_squared(from, up, hn::Set(d, disc.along), hn::Set(d, disc.across));
      return !hn::AllFalse(d, hn::Lt(apart, best));
    };
    Floats up;
    for (std::size_t n = 0; n < count; ++n) {
      const NetPart& part = parts[near[n]];
      if (!may_be_nearer(part.disc, up)) continue;
      for (std::uint32_t t = part.first; t < part.last; ++t) {
        if (may_be_nearer(triangles[t].disc, up)) best = hn::Min(best, squared_distance(triangles[t], p, up));
      }
    }
    hn::StoreU(best, d, tile.squared + x);
  }
}

}  // namespace palpate::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace palpate::internal {

HWY_EXPORT(filter_parts);
HWY_EXPORT(measure);

NearPartRows::NearPartRows(NearParts& parts) : part(parts.part.data()), count(parts.count) {
  for (std::size_t m = 0; m < parts.number.size(); ++m) number[m] = parts.number[m].data();
}

void NearParts::make_room(std::size_t largest) {
  const std::size_t room = largest + kTileVoxels;
  if (part.size() >= room) return;
  for (auto& numbers : number) numbers.resize(room);
  part.resize(room);
}

void NearParts::add(const NetDisc& disc, std::uint32_t its_part) {
  const float numbers[8] = {disc.middle[0], disc.middle[1], disc.middle[2], disc.along,
                            disc.normal[0], disc.normal[1], disc.normal[2], disc.across};
  for (std::size_t m = 0; m < 8; ++m) number[m][count] = numbers[m];
  part[count] = static_cast<std::int32_t>(its_part);
  ++count;
}

void NearParts::move_nearest_first() {
  const auto apart = number[8].begin();
  const auto least =
      static_cast<std::size_t>(std::min_element(apart, apart + static_cast<std::ptrdiff_t>(count)) - apart);
  for (auto& numbers : number) std::swap(numbers[0], numbers[least]);
  std::swap(part[0], part[least]);
}

void select_near(NearParts& all, const VoxelsBall& ball, float reach_mm, NearParts& selected) {
  selected.make_room(all.count);
  selected.count =
      HWY_DYNAMIC_DISPATCH(filter_parts)(NearPartRows(all), ball, reach_mm, NearPartRows(selected));
}

void measure_tile(const NetPart* parts, const NetTriangle* triangles, const NearParts& near, NetTile& tile) {
  HWY_DYNAMIC_DISPATCH(measure)(parts, triangles, near.part.data(), near.count, tile);
}

}  // namespace palpate::internal
#endif  // HWY_ONCE
