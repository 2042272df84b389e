#pragma once

#include <memory>
#include <string>
#include <utility>

#include "base/test_files.h"
#include "contact/test_model.h"
#include "palpate/loading/loading.h"
#include "palpate/scene/script.h"

namespace palpate::testing {

/// The ball of contact/test_model.h as a loaded scene.
inline LoadedScene loaded_ball(double cartilage_mm = 0) {
  Model model = ball_model({0.6, 0.6, 0.9}, 1.0, cartilage_mm);
  model.title = "ball";
  model.content_hash = 42;
  return {Scene{}, std::make_shared<const Model>(std::move(model)), ""};
}

/// The ball with a burr of 4 mm diameter as the tool.
inline LoadedScene loaded_burr() {
  LoadedScene loaded = loaded_ball();
  loaded.scene.force.method = ForceMethod::kProxy;
  Model model = *loaded.model;
  model.tools[0].radius_mm = 2;
  model.tools[0].burr = BurrSettings{.spindle = Eigen::Vector3d(1, 0, 0)};
  loaded.model = std::make_shared<const Model>(std::move(model));
  return loaded;
}

inline Script press_script(const std::string& structure, double force_N = 1.0) {
  auto script = parse_script(
      "[[step]]\napproach = \"" + structure + "\"\n[[step]]\npress = " + std::to_string(force_N) +
          "\n[[step]]\nhold = 0.6\n[[step]]\nslide = 3.0\ndirection = \"left\"\n[[step]]\nleave = true\n",
      "test script");
  PALPATE_CHECK(script.ok());
  return *script;
}

}  // namespace palpate::testing
