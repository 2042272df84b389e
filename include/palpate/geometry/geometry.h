#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include "palpate/base/check.h"

/// Points, vectors and transforms that carry their frame in their type, so that mixing two frames
/// does not compile. Lengths are millimetres except in Voxel, which counts voxels. Column vectors;
/// X_AB maps coordinates in B to coordinates in A, and composition visibly cancels:
/// X_AC = X_AB * X_BC. See docs/concepts/conventions.md.
namespace palpate {

struct Voxel {};    ///< Continuous voxel index; voxel centres at integers, as in ITK.
struct Patient {};  ///< LPS, as in DICOM and ITK: +x to the patient's left, +y posterior, +z superior; mm.
struct World {};    ///< The simulator's workspace: +x right, +y forward, +z up; mm.
struct Device {};   ///< Frame of a haptic device; mm.

template <class To, class From>
class Transform;
template <class To, class From>
class Rotation;

namespace internal {

/// Link-time check of the memory layout of Eigen's types, which depends on flags such as -mavx2 and
/// -march=native and on Eigen's macros. The library defines this function only for its own alignment, so a
/// program compiled with another alignment fails to link instead of corrupting memory.
template <int bytes>
struct CompiledWithEigenTypesAlignedTo {
  static bool as_the_library_was() noexcept;
};
/// References the function in every object file.
inline const bool kEigenTypesAreAlike =
    CompiledWithEigenTypesAlignedTo<EIGEN_MAX_STATIC_ALIGN_BYTES>::as_the_library_was();

}  // namespace internal

/// A displacement, direction, velocity or force with components in Frame.
template <class Frame>
class Vector {
 public:
  Vector() : v_(Eigen::Vector3d::Zero()) {}
  Vector(double x, double y, double z) : v_(x, y, z) {}
  explicit Vector(const Eigen::Vector3d& v) : v_(v) {}

  const Eigen::Vector3d& eigen() const { return v_; }
  double x() const { return v_.x(); }
  double y() const { return v_.y(); }
  double z() const { return v_.z(); }
  double operator[](int i) const { return v_[i]; }
  double& operator[](int i) { return v_[i]; }

  double norm() const { return v_.norm(); }
  double squared_norm() const { return v_.squaredNorm(); }
  double dot(const Vector& o) const { return v_.dot(o.v_); }
  Vector cross(const Vector& o) const { return Vector(v_.cross(o.v_)); }
  /// Unit vector of the same direction; the zero vector is returned unchanged.
  Vector normalized() const {
    const double n = norm();
    return n > 0 ? Vector(v_ / n) : Vector();
  }
  bool all_finite() const { return v_.allFinite(); }

  Vector operator-() const { return Vector(-v_); }
  Vector operator+(const Vector& o) const { return Vector(v_ + o.v_); }
  Vector operator-(const Vector& o) const { return Vector(v_ - o.v_); }
  Vector operator*(double s) const { return Vector(v_ * s); }
  Vector operator/(double s) const { return Vector(v_ / s); }
  Vector& operator+=(const Vector& o) { return *this = *this + o; }
  Vector& operator-=(const Vector& o) { return *this = *this - o; }
  friend Vector operator*(double s, const Vector& v) { return v * s; }
  bool operator==(const Vector& o) const { return v_ == o.v_; }

 private:
  Eigen::Vector3d v_;
};

/// A position in Frame. Points subtract to vectors; adding two points does not compile.
template <class Frame>
class Point {
 public:
  Point() : p_(Eigen::Vector3d::Zero()) {}
  Point(double x, double y, double z) : p_(x, y, z) {}
  explicit Point(const Eigen::Vector3d& p) : p_(p) {}

  const Eigen::Vector3d& eigen() const { return p_; }
  double x() const { return p_.x(); }
  double y() const { return p_.y(); }
  double z() const { return p_.z(); }
  double operator[](int i) const { return p_[i]; }
  double& operator[](int i) { return p_[i]; }
  bool all_finite() const { return p_.allFinite(); }

  Vector<Frame> operator-(const Point& o) const { return Vector<Frame>(p_ - o.p_); }
  Point operator+(const Vector<Frame>& v) const { return Point(p_ + v.eigen()); }
  Point operator-(const Vector<Frame>& v) const { return Point(p_ - v.eigen()); }
  Point& operator+=(const Vector<Frame>& v) { return *this = *this + v; }
  bool operator==(const Point& o) const { return p_ == o.p_; }

 private:
  Eigen::Vector3d p_;
};

/// R_AB: a proper rotation, stored as a unit quaternion, from From's axes to To's.
template <class To, class From>
class Rotation {
 public:
  Rotation() : q_(Eigen::Quaterniond::Identity()) {}
  /// Normalises q; a zero quaternion is a bug.
  explicit Rotation(const Eigen::Quaterniond& q) : q_(q) {
    PALPATE_CHECK(q.squaredNorm() > 0);
    q_.normalize();
  }
  static Rotation about(const Eigen::Vector3d& unit_axis, double radians) {
    return Rotation(Eigen::Quaterniond(Eigen::AngleAxisd(radians, unit_axis)));
  }

  const Eigen::Quaterniond& quaternion() const { return q_; }
  Rotation<From, To> inverse() const { return Rotation<From, To>(q_.conjugate()); }
  Vector<To> operator*(const Vector<From>& v) const { return Vector<To>(q_ * v.eigen()); }
  template <class Source>
  Rotation<To, Source> operator*(const Rotation<From, Source>& r) const {
    return Rotation<To, Source>(q_ * r.quaternion());
  }
  /// Spherical linear interpolation to `end` along the shorter arc, t in [0,1].
  Rotation slerp(double t, const Rotation& end) const { return Rotation(q_.slerp(t, end.q_)); }

 private:
  Eigen::Quaterniond q_;
};

/// Shortest rotation that aligns one direction with another, as a unit quaternion. Both are in the same
/// frame, non-zero, of any length. Opposite directions give a half turn about an arbitrary perpendicular
/// axis. Equivalent to Eigen's FromTwoVectors without its SVD of two nearly opposite directions, which costs
/// ten seconds of compile time wherever it is instantiated.
inline Eigen::Quaterniond shortest_rotation(const Eigen::Vector3d& from, const Eigen::Vector3d& onto) {
  const Eigen::Vector3d a = from.normalized(), b = onto.normalized();
  const double twice_cosine = (a + b).norm();  // twice the cosine of half the rotation angle
  Eigen::Quaterniond turn;
  if (twice_cosine < 1e-12) {
    turn.w() = 0;
    turn.vec() = a.unitOrthogonal();
  } else {
    turn.w() = twice_cosine / 2;
    turn.vec() = a.cross(b) / twice_cosine;
  }
  return turn;
}

/// X_AB: an invertible affine map p_A = L p_B + t. Transforms between millimetre frames are rigid; between
/// Voxel and Patient the linear part contains spacing and direction, and may be left-handed.
template <class To, class From>
class Transform {
 public:
  Transform() : linear_(Eigen::Matrix3d::Identity()), translation_(Eigen::Vector3d::Zero()) {}
  Transform(const Eigen::Matrix3d& linear, const Eigen::Vector3d& translation)
      : linear_(linear), translation_(translation) {}
  Transform(const Rotation<To, From>& rotation, const Vector<To>& translation)
      : linear_(rotation.quaternion().toRotationMatrix()), translation_(translation.eigen()) {}

  const Eigen::Matrix3d& linear() const { return linear_; }
  const Eigen::Vector3d& translation() const { return translation_; }

  Point<To> operator*(const Point<From>& p) const { return Point<To>(linear_ * p.eigen() + translation_); }
  Vector<To> operator*(const Vector<From>& v) const { return Vector<To>(linear_ * v.eigen()); }
  template <class Source>
  Transform<To, Source> operator*(const Transform<From, Source>& x) const {
    return Transform<To, Source>(linear_ * x.linear(), linear_ * x.translation() + translation_);
  }
  /// Inverse map. A singular linear part is a bug: readers reject such files.
  Transform<From, To> inverse() const {
    const double d = linear_.determinant();
    PALPATE_CHECK(d != 0.0);
    const Eigen::Matrix3d inv = linear_.inverse();
    return Transform<From, To>(inv, -(inv * translation_));
  }

 private:
  Eigen::Matrix3d linear_;
  Eigen::Vector3d translation_;
};

}  // namespace palpate
