#include <algorithm>
#include <cmath>

#include "phantoms/shape_node.h"

namespace palpate {
namespace {

using Eigen::Vector3d;
using Node = Shape::Node;

// Two distances that differ by more than this at the centre of a ball keep their order throughout it: each
// changes by at most the radius. Includes a tolerance for rounding.
double decisive_difference(const Ball& ball) {
  return 2 * ball.radius + 1e-6;
}

struct Union final : Node {
  explicit Union(std::vector<Ptr> nodes) : parts(std::move(nodes)) {}
  double distance(const Vector3d& p) const override {
    double smallest = parts.front()->distance(p);
    for (std::size_t i = 1; i < parts.size(); ++i) smallest = std::min(smallest, parts[i]->distance(p));
    return smallest;
  }
  Vector3d gradient(const Vector3d& p) const override {
    const Node* nearest = nullptr;
    double smallest = 0;
    for (const Ptr& part : parts) {
      const double d = part->distance(p);
      if (nearest != nullptr && !(d < smallest)) continue;
      nearest = part.get();
      smallest = d;
    }
    return nearest->gradient(p);
  }
  Within within(const Ptr& self, const Ball& ball) const override {
    std::vector<Within> near;
    double smallest = 0;
    for (const Ptr& part : parts) {
      near.push_back(part->within(part, ball));
      smallest = near.size() == 1 ? near.back().distance : std::min(smallest, near.back().distance);
    }
    std::vector<Ptr> candidates;
    for (const Within& part : near) {
      if (part.distance <= smallest + decisive_difference(ball)) candidates.push_back(part.node);
    }
    if (candidates.size() == 1) return {candidates.front(), smallest};
    if (candidates == parts) return {self, smallest};
    return {std::make_shared<Union>(std::move(candidates)), smallest};
  }

  std::vector<Ptr> parts;
};

// Quadratic smooth minimum: its gradient is a convex combination of both, so it stays Lipschitz 1.
struct Blend final : Node {
  Blend(Ptr first, Ptr second, double w) : a(std::move(first)), b(std::move(second)), width(w) {}
  double join(double da, double db) const {
    const double overlap = std::max(width - std::abs(da - db), 0.0);
    return std::min(da, db) - overlap * overlap / (4 * width);
  }
  double distance(const Vector3d& p) const override { return join(a->distance(p), b->distance(p)); }
  Vector3d gradient(const Vector3d& p) const override {
    const double da = a->distance(p), db = b->distance(p);
    const double fraction_of_b = std::clamp(0.5 + 0.5 * (da - db) / width, 0.0, 1.0);
    return (1 - fraction_of_b) * a->gradient(p) + fraction_of_b * b->gradient(p);
  }
  Within within(const Ptr& self, const Ball& ball) const override {
    const Within wa = a->within(a, ball), wb = b->within(b, ball);
    const double decisive = width + decisive_difference(ball);
    if (wb.distance - wa.distance > decisive) return wa;
    if (wa.distance - wb.distance > decisive) return wb;
    const double d = join(wa.distance, wb.distance);
    if (wa.node == a && wb.node == b) return {self, d};
    return {std::make_shared<Blend>(wa.node, wb.node, width), d};
  }

  Ptr a, b;
  double width;
};

struct Intersection final : Node {
  Intersection(Ptr first, Ptr second) : a(std::move(first)), b(std::move(second)) {}
  double distance(const Vector3d& p) const override { return std::max(a->distance(p), b->distance(p)); }
  Vector3d gradient(const Vector3d& p) const override {
    return a->distance(p) >= b->distance(p) ? a->gradient(p) : b->gradient(p);
  }
  Within within(const Ptr& self, const Ball& ball) const override {
    const Within wa = a->within(a, ball), wb = b->within(b, ball);
    if (wa.distance - wb.distance > decisive_difference(ball)) return wa;
    if (wb.distance - wa.distance > decisive_difference(ball)) return wb;
    const double d = std::max(wa.distance, wb.distance);
    if (wa.node == a && wb.node == b) return {self, d};
    return {std::make_shared<Intersection>(wa.node, wb.node), d};
  }

  Ptr a, b;
};

struct Complement final : Node {
  explicit Complement(Ptr node) : a(std::move(node)) {}
  double distance(const Vector3d& p) const override { return -a->distance(p); }
  Vector3d gradient(const Vector3d& p) const override { return -a->gradient(p); }
  Within within(const Ptr& self, const Ball& ball) const override {
    const Within w = a->within(a, ball);
    return {w.node == a ? self : std::make_shared<Complement>(w.node), -w.distance};
  }

  Ptr a;
};

struct Offset final : Node {
  Offset(Ptr node, double m) : a(std::move(node)), margin(m) {}
  double distance(const Vector3d& p) const override { return a->distance(p) - margin; }
  Vector3d gradient(const Vector3d& p) const override { return a->gradient(p); }
  Within within(const Ptr& self, const Ball& ball) const override {
    const Within w = a->within(a, ball);
    return {w.node == a ? self : std::make_shared<Offset>(w.node, margin), w.distance - margin};
  }

  Ptr a;
  double margin;
};

// Intersection; the rounded form is the complement of the blend of both complements.
Node::Ptr common_part(const Node::Ptr& a, const Node::Ptr& b, double rounding) {
  PALPATE_CHECK(std::isfinite(rounding) && rounding >= 0);
  if (rounding == 0) return std::make_shared<Intersection>(a, b);
  return std::make_shared<Complement>(
      std::make_shared<Blend>(std::make_shared<Complement>(a), std::make_shared<Complement>(b), rounding));
}

}  // namespace

Shape::Shape(std::shared_ptr<const Node> node) : node_(std::move(node)) {
  PALPATE_CHECK(node_ != nullptr);
}

double Shape::distance_mm(const Point<Patient>& p) const {
  return node_->distance(p.eigen());
}

Vector<Patient> Shape::normal(const Point<Patient>& p) const {
  const Vector3d gradient = node_->gradient(p.eigen());
  // the direction is arbitrary if a blend's gradients cancel
  const double length = gradient.norm();
  return Vector<Patient>(length > 0 ? Vector3d(gradient / length) : Vector3d::UnitZ());
}

Shape Shape::unite(std::vector<Shape> shapes) {
  PALPATE_CHECK(!shapes.empty());
  std::vector<Node::Ptr> nodes;
  for (const Shape& shape : shapes) nodes.push_back(shape.node());
  return Shape(std::make_shared<Union>(std::move(nodes)));
}

Shape Shape::blend(const std::vector<Shape>& shapes, double width_mm) {
  PALPATE_CHECK(!shapes.empty() && std::isfinite(width_mm) && width_mm > 0);
  Node::Ptr joined = shapes.front().node();
  for (std::size_t i = 1; i < shapes.size(); ++i) {
    joined = std::make_shared<Blend>(joined, shapes[i].node(), width_mm);
  }
  return Shape(joined);
}

Shape Shape::subtract(const Shape& from, const Shape& what, double rounding_mm) {
  return Shape(common_part(from.node(), std::make_shared<Complement>(what.node()), rounding_mm));
}

Shape Shape::intersect(const Shape& a, const Shape& b, double rounding_mm) {
  return Shape(common_part(a.node(), b.node(), rounding_mm));
}

Shape Shape::offset(const Shape& shape, double margin_mm) {
  PALPATE_CHECK(std::isfinite(margin_mm));
  return Shape(std::make_shared<Offset>(shape.node(), margin_mm));
}

}  // namespace palpate
