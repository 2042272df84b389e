#include "server/plan_json.h"

#include <gtest/gtest.h>

#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::testing::Json;
using palpate::testing::TestServer;
using palpate::testing::TestViewer;

ViewedPlan test_plan() {
  ViewedPlan plan;
  plan.trajectories = {{"hole\x1b[2J", {1, 2, 3}, {4, 5, 6.5}, 2, {}, 5, {}}};
  plan.keep_away = {{2, 3}};
  plan.version = 4;
  plan.can_change = true;
  return plan;
}

TEST(PlanJson, HasTheDocumentsKeys) {
  EXPECT_EQ(Json::parse(plan_json(test_plan())), Json::parse(R"({
    "type": "plan", "version": 4, "saved": true, "can_change": true,
    "trajectories": [{"name": "hole\\u001b[2J", "entry_mm": [1, 2, 3], "target_mm": [4, 5, 6.5], "entry_within_mm": 2.0, "target_within_mm": null,
                      "angle_within_deg": 5.0, "depth_within_mm": null}],
    "keep_away": [{"label": 2, "mm": 3.0}]})"));
}

TEST(Viewer, PlansAreSentToSubscribersOnEachChange) {
  TestServer test;
  test.host.rehearse(test_plan());
  TestViewer viewer(test.port()), other(test.port());
  other.greet();
  viewer.greet({{"plan", true}});
  EXPECT_EQ(viewer.text("plan")["version"], 4);
  viewer.send({{"type", "plan"}, {"id", 7}, {"version", 3}, {"trajectory", 0}, {"name", "late"}});
  EXPECT_EQ(viewer.text("refused")["where"], "version");
  viewer.send({{"type", "plan"}, {"id", 8}, {"version", 4}, {"trajectory", 0}, {"name", "another"}});
  EXPECT_EQ(viewer.text("done")["id"], 8);
  const Json changed = viewer.text("plan");
  EXPECT_EQ(changed["version"], 5);
  EXPECT_EQ(changed["trajectories"][0]["name"], "another");
  EXPECT_EQ(changed["saved"], false);
  viewer.send({{"type", "plan"}, {"id", 9}, {"version", 5}, {"save", true}});
  EXPECT_EQ(viewer.text("plan")["saved"], true);
  TestViewer late(test.port());
  late.greet({{"plan", true}});
  EXPECT_EQ(late.text("plan")["version"], 6);
  // a viewer without a subscription gets no plan
  other.send({{"type", "stop"}, {"id", 1}});
  for (Json next = other.text(); next["type"] != "done"; next = other.text())
    EXPECT_EQ(next["type"], "state");
}

TEST(Viewer, PlanRequestsHaveExactlyOneAction) {
  TestServer test;
  test.host.rehearse(test_plan());
  TestViewer viewer(test.port());
  viewer.greet();
  const auto refused = [&](Json request) {
    request.update({{"type", "plan"}, {"id", 1}, {"version", 4}});
    viewer.send(request);
    EXPECT_EQ(viewer.text("refused")["id"], 1) << request;
  };
  refused(Json::object());
  refused({{"save", true}, {"back_to", 1}});
  refused({{"save", true}, {"trajectory", 0}});
  refused({{"remove", true}});
  refused({{"trajectory", 0}});
  refused({{"trajectory", 0}, {"remove", true}, {"name", "x"}});
  refused({{"trajectory", -1}, {"name", "x"}});
  refused({{"trajectory", 0}, {"entry_mm", {1, 2}}});
  refused({{"name", "x"}});
}

}  // namespace
}  // namespace palpate::server
