#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/phantoms/phantoms.h"

namespace palpate {

/// Key of a phantom's name.
struct PhantomKey {
  std::string_view name, unit, meaning;
};

/// Visits every key of a phantom once, with a reference to its value: the parser, the writer of names, the
/// range check and the table of the documentation are visitors of one declaration.
class PhantomKeyVisitor {
 public:
  virtual ~PhantomKeyVisitor() = default;
  virtual void number(const PhantomKey& key, double smallest, double largest, double& value) = 0;
  virtual void integer(const PhantomKey& key, std::uint64_t largest, std::uint64_t& value) = 0;
  /// Voxel edges along the patient's x, y and z.
  virtual void edges(const PhantomKey& key, double smallest, double largest, Eigen::Vector3d& value) = 0;
  virtual void word(const PhantomKey& key, std::span<const std::string_view> words, std::string& value) = 0;
  /// Any of the words, without repetition.
  virtual void words(const PhantomKey& key, std::span<const std::string_view> words,
                     std::vector<std::string>& values) = 0;
};

/// Visits the keys in alphabetical order.
void visit_keys(PhantomParameters& parameters, PhantomKeyVisitor& visitor);

/// Phantoms with default parameters, in the order of phantom_names().
const std::vector<PhantomParameters>& mean_phantoms();
/// Name without parameters.
const std::string& base_name(const PhantomParameters& parameters);
PhantomSettings& settings_of(PhantomParameters& parameters);
const PhantomSettings& settings_of(const PhantomParameters& parameters);

/// Checks every value against the range of its key.
Result<void> check_key_ranges(const PhantomParameters& parameters);
/// Checks ranges and combinations, as the parser and make_phantom() require.
Result<void> check_phantom(const PhantomParameters& parameters);

}  // namespace palpate
