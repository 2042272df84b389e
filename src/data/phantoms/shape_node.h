#pragma once

#include <memory>

#include "palpate/phantoms/primitives.h"

namespace palpate {

/// Sphere in the patient frame; mm.
struct Ball {
  Eigen::Vector3d centre;
  double radius;
};

/// Primitive or operation of a Shape. Every distance is Lipschitz continuous with constant 1, which allows
/// whole blocks of voxels to be decided by the distance at their centre.
struct Shape::Node {
  using Ptr = std::shared_ptr<const Node>;
  /// Node with bit-identical distances everywhere within a ball, and its distance at the centre.
  struct Within {
    Ptr node;
    double distance;
  };

  virtual ~Node() = default;
  virtual double distance(const Eigen::Vector3d& p) const = 0;
  /// Gradient of the distance; of length 1 except inside the fillet of a blend, where it is shorter.
  virtual Eigen::Vector3d gradient(const Eigen::Vector3d& p) const = 0;
  /// Simplifies the node for a ball by dropping operands that cannot affect it. `self` is this node.
  virtual Within within(const Ptr& self, const Ball& ball) const { return {self, distance(ball.centre)}; }
};

}  // namespace palpate
