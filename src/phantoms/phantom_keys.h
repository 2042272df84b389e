#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/phantoms/phantoms.h"

namespace palpate {

/// A key of a phantom's name.
struct PhantomKey {
  std::string_view name, unit, meaning;
};

/// Sees every key of a phantom once, with the value that stands behind it: the parser, the writer of names,
/// the check of ranges and the table of the documentation are visitors of one declaration.
class PhantomKeyVisitor {
 public:
  virtual ~PhantomKeyVisitor() = default;
  virtual void number(const PhantomKey& key, double least, double most, double& value) = 0;
  virtual void whole(const PhantomKey& key, std::uint64_t most, std::uint64_t& value) = 0;
  /// Edges of a voxel along the patient's x, y and z.
  virtual void edges(const PhantomKey& key, double least, double most, Eigen::Vector3d& value) = 0;
  virtual void word(const PhantomKey& key, std::span<const std::string_view> words, std::string& value) = 0;
  /// Any of the words, none of them twice.
  virtual void words(const PhantomKey& key, std::span<const std::string_view> words,
                     std::vector<std::string>& values) = 0;
};

/// In alphabetical order.
void visit_keys(PhantomParameters& parameters, PhantomKeyVisitor& visitor);

/// The mean phantoms, in the order of phantom_names().
const std::vector<PhantomParameters>& mean_phantoms();
/// Without parameters.
const std::string& base_name(const PhantomParameters& parameters);
PhantomSettings& settings_of(PhantomParameters& parameters);
const PhantomSettings& settings_of(const PhantomParameters& parameters);

/// Every value against the range of its key.
Result<void> check_key_ranges(const PhantomParameters& parameters);
/// What the parser and make_phantom() refuse: these ranges, and what does not go together.
Result<void> check_phantom(const PhantomParameters& parameters);

}  // namespace palpate
