#pragma once

#include <memory>

#include "palpate/phantoms/primitives.h"

namespace palpate {

/// A ball in the patient frame, mm.
struct Ball {
  Eigen::Vector3d centre;
  double radius;
};

/// One operation or primitive of a Shape. Every distance changes by at most 1 mm per mm, which is what
/// lets whole blocks of voxels be decided from their centre.
struct Shape::Node {
  using Ptr = std::shared_ptr<const Node>;
  /// A node that gives the same distances, bit for bit, everywhere in a ball, and its distance at the centre.
  struct Within {
    Ptr node;
    double distance;
  };

  virtual ~Node() = default;
  virtual double distance(const Eigen::Vector3d& p) const = 0;
  /// Of the distance; of length 1 except inside the fillet of a blend, where it is shorter.
  virtual Eigen::Vector3d gradient(const Eigen::Vector3d& p) const = 0;
  /// Leaves out the operands that decide nothing in the ball. `self` is this node.
  virtual Within within(const Ptr& self, const Ball& ball) const { return {self, distance(ball.centre)}; }
};

}  // namespace palpate
