#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <new>
#include <stdexcept>
#include <thread>

#include "session/test_viewed.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::kViewedBone;
using testing::kViewedCartilage;
using testing::sent_N;
using testing::soon;
using testing::Viewed;

TEST_F(Viewed, RampsAreRebuiltForADirectMethod) {
  // fields are not generated before this thread has made its other requests
  std::atomic<bool> may_be_made{false};
  rebuild_fields_ = [&](const Model& model, const Model& made, const Progress& progress) {
    while (!may_be_made && !progress.stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return with_rebuilt_fields(model, made, progress);
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.3;
  SettingsRequest direct;
  direct.method = "trilinear";
  EXPECT_EQ(error_of(softer).what, "no error");
  EXPECT_EQ(error_of(direct).what, "no error");
  EXPECT_EQ(live_->state().method_awaited, "trilinear");
  // the proxy stays active while the fields are generated; the last request wins
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  EXPECT_EQ(error_of(softer).what, "no error");
  may_be_made = true;
  ASSERT_TRUE(soon([&] { return live_->state().method == ForceMethod::kTrilinear; }));
  const auto made = changes();
  ASSERT_GE(made.size(), 3u);
  EXPECT_EQ(made.back().tissue, ModelChange::kFieldsRebuilt);
  EXPECT_EQ(made.back().version, live_->state().model_version);
  ASSERT_NO_FATAL_FAILURE(press(2));
  EXPECT_NEAR(stiffness(), 0.5, 1e-12);
  ASSERT_TRUE(soon([&] { return std::abs(sent_N(latest()) - 1.0) < 0.1; })) << sent_N(latest());
  // the other methods were generated with it
  direct.method = "b-spline";
  EXPECT_EQ(error_of(direct).what, "no error");
  EXPECT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kSpline); }));
  EXPECT_EQ(changes().size(), made.size()) << "they were made once";
  EXPECT_EQ(latest().device[0].flags & kFlagMethodMissing, 0u);
}

TEST_F(Viewed, ADirectMethodIsMadeReadyWhenItIsChosenFirst) {
  every_method_ = false;
  std::atomic<bool> may_be_made{false};
  std::atomic<int> made{0};
  prepare_methods_ = [&](auto model, auto methods, const Progress& progress) {
    while (!may_be_made && !progress.stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ++made;
    return with_methods(std::move(model), methods, progress);
  };
  start();
  EXPECT_EQ(live_->scene().methods.size(), kForceMethods.size());
  ASSERT_NO_FATAL_FAILURE(press(1));
  SettingsRequest spline, proxy;
  spline.method = "b-spline";
  proxy.method = "proxy";
  ASSERT_EQ(error_of(spline).what, "no error");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  EXPECT_EQ(live_->state().method_awaited, "b-spline");
  EXPECT_EQ(live_->method_awaited(), ForceMethod::kSpline);
  // a change in the meantime delays it; the change itself takes effect immediately
  TissueRequest thicker;
  thicker.tissue = kViewedBone;
  thicker.changes[&ContactProperties::viscosity_N_s_per_mm] = 0.002;
  ASSERT_EQ(error_of(thicker).what, "no error");
  may_be_made = true;
  ASSERT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kSpline); }));
  EXPECT_EQ(live_->state().method_awaited, "");
  EXPECT_EQ(changes().size(), 1u) << "of the tissue: being ready for more is no new version";
  EXPECT_EQ(latest().model_version, 2u);
  // from then on the method is available at once
  ASSERT_EQ(error_of(proxy).what, "no error");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  const int before = made;
  ASSERT_EQ(error_of(spline).what, "no error");
  EXPECT_EQ(live_->state().method, ForceMethod::kSpline);
  EXPECT_EQ(made, before);
  // no tick rendered another method in its place
  std::vector<std::uint8_t> methods_in_order;
  for (const TickRecord& tick : ticks()) {
    EXPECT_EQ(tick.device[0].flags & kFlagMethodMissing, 0u);
    if (methods_in_order.empty() || methods_in_order.back() != tick.method)
      methods_in_order.push_back(tick.method);
  }
  constexpr auto kNow = static_cast<std::uint8_t>(ForceMethod::kProxy),
                 kThen = static_cast<std::uint8_t>(ForceMethod::kSpline);
  EXPECT_EQ(methods_in_order.front(), kNow);
  EXPECT_EQ(methods_in_order.back(), kThen);
  for (const std::uint8_t method : methods_in_order) EXPECT_TRUE(method == kNow || method == kThen);
}

TEST_F(Viewed, LaterMethodRequestReplacesAPendingOne) {
  every_method_ = false;
  std::atomic<bool> may_be_made{false};
  prepare_methods_ = [&](auto model, auto methods, const Progress& progress) {
    while (!may_be_made && !progress.stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return with_methods(std::move(model), methods, progress);
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  const auto choose = [&](const char* method) {
    SettingsRequest request;
    request.method = method;
    ASSERT_EQ(error_of(request).what, "no error");
  };
  choose("b-spline");
  choose("smooth-sphere");
  EXPECT_EQ(live_->state().method_awaited, "smooth-sphere");
  may_be_made = true;
  ASSERT_TRUE(soon([&] { return live_->state().method == ForceMethod::kSmoothSphere; }));
  // returning to the previous method cancels the request
  may_be_made = false;
  choose("stored-normals");
  choose("proxy");
  may_be_made = true;
  EXPECT_EQ(live_->state().method_awaited, "");
  // after another change of stiffness the fields are regenerated, including those of a method never chosen
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.5;
  ASSERT_EQ(error_of(softer).what, "no error");
  choose("gaussian-sphere");
  ASSERT_TRUE(soon([&] { return live_->state().method == ForceMethod::kGaussianSphere; }));
  EXPECT_EQ(changes().back().tissue, ModelChange::kFieldsRebuilt);
  EXPECT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kGaussianSphere); }));
  EXPECT_EQ(latest().device[0].flags & kFlagMethodMissing, 0u);
}

TEST_F(Viewed, ReportsMethodPreparationFailure) {
  every_method_ = false;
  std::atomic<int> tries{0};
  prepare_methods_ = [&](auto model, auto methods, const Progress& progress) {
    if (++tries == 1) throw std::bad_alloc();
    return with_methods(std::move(model), methods, progress);
  };
  start();
  SettingsRequest spline;
  spline.method = "b-spline";
  ASSERT_EQ(error_of(spline).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->method_failure().has_value(); }));
  EXPECT_EQ(live_->method_failure()->where, "b-spline");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  EXPECT_EQ(live_->state().method_awaited, "");
  // the memory limit is respected
  set_reading_limits({.max_memory_bytes = 1});
  ASSERT_EQ(error_of(spline).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->method_failure().has_value(); }));
  set_reading_limits({});
  EXPECT_THAT(live_->method_failure()->what, HasSubstr("of memory"));
  EXPECT_EQ(tries, 1);
  ASSERT_EQ(error_of(spline).what, "no error");
  EXPECT_TRUE(soon([&] { return live_->state().method == ForceMethod::kSpline; }));
}

TEST_F(Viewed, LawTakesEffectWhenItsSurfacesAreReady) {
  shell_ = ElasticConstants{60, 0.45};
  std::atomic<bool> may_be_made{false};
  std::atomic<int> made{0};
  prepare_law_ = [&](const Model& model, TissueLaw law, std::size_t devices,
                     const Progress& progress) -> Result<MeasuredCells> {
    while (!may_be_made && !progress.stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ++made;
    auto under = measured_under_law(model, law, devices, progress);
    if (!under || !is_elastic(law)) return under;
    // as if this machine were too slow for one of the laws
    const bool is_slow = law == TissueLaw::kNeoHookean;
    auto carried = std::make_shared<Model>(*under->model);
    carried->tissue_cell_factor = is_slow ? 1.6 : 1;
    return MeasuredCells{std::move(carried), is_slow ? "coarser cells" : ""};
  };
  start();
  EXPECT_THAT(live_->scene().laws,
              ::testing::ElementsAre("elastic", "neo-hookean", "exponential", "chainmail", "layers"));
  ASSERT_NO_FATAL_FAILURE(press(1));
  const auto apply_law = [&](const char* law) {
    SettingsRequest request;
    request.law = law;
    return live_->set(request);
  };
  ASSERT_EQ(apply_law("elastic").value(), RequestOutcome::kDone);
  EXPECT_EQ(live_->state().law, "layers");
  EXPECT_EQ(live_->state().law_awaited, "elastic");
  // returning to the previous law cancels the request
  ASSERT_TRUE(apply_law("layers").ok());
  EXPECT_EQ(live_->state().law_awaited, "");
  ASSERT_TRUE(apply_law("elastic").ok());
  // a tissue edited in the meantime is rendered as edited, and the surfaces include the edit
  TissueRequest slippery;
  slippery.tissue = kViewedCartilage;
  slippery.changes[&ContactProperties::friction] = 0.05;
  ASSERT_EQ(error_of(slippery).what, "no error");
  may_be_made = true;
  ASSERT_TRUE(soon([&] { return live_->state().law == "elastic"; }));
  EXPECT_EQ(live_->state().law_awaited, "");
  EXPECT_FALSE(live_->state().law_failure);
  EXPECT_GE(made, 1);
  EXPECT_EQ(live_->state().tissues[kViewedCartilage].friction, 0.05);
  EXPECT_EQ(changes().back().version, live_->state().model_version);
  EXPECT_EQ(law_of(changes().back()), TissueLaw::kElastic);
  // the solver thread runs, and the tick renders its solution
  ASSERT_TRUE(soon([&] { return latest().solver_frame > 3 && live_->deformation(0) != nullptr; }));
  EXPECT_TRUE(soon([&] { return sent_N(latest()) > 0.01; })) << sent_N(latest());
  EXPECT_EQ(latest().device[0].flags & kFlagInside, 0u);

  // the other elastic law has the same surfaces, but its cell size has not been measured yet
  const int before = made;
  ASSERT_TRUE(apply_law("neo-hookean").ok());
  ASSERT_TRUE(soon([&] { return live_->state().law == "neo-hookean"; }));
  EXPECT_EQ(made, before + 1);
  EXPECT_EQ(changes().back().contact.stiffness_N_per_mm, 1.6);
  EXPECT_EQ(live_->coarser_tissue(), "coarser cells");
  EXPECT_THAT(live_->later_tissue_warnings(), ::testing::ElementsAre("coarser cells"));
  // from then on it takes effect at once
  ASSERT_TRUE(apply_law("elastic").ok());
  EXPECT_EQ(live_->state().law, "elastic");
  EXPECT_EQ(changes().back().contact.stiffness_N_per_mm, 1);
  EXPECT_EQ(live_->coarser_tissue(), "");
  ASSERT_TRUE(apply_law("neo-hookean").ok());
  EXPECT_EQ(live_->state().law, "neo-hookean");
  EXPECT_EQ(made, before + 1);
  ASSERT_TRUE(apply_law("layers").ok());
  ASSERT_TRUE(soon([&] { return live_->state().law == "layers"; }));
  EXPECT_TRUE(soon([&] { return live_->deformation(0) == nullptr; }));
}

TEST_F(Viewed, ReportsLawPreparationFailure) {
  shell_ = ElasticConstants{20, 0.45};
  int tries = 0;
  prepare_law_ = [&](const Model& model, TissueLaw law, std::size_t devices, const Progress& progress) {
    if (++tries == 1) throw std::bad_alloc();
    return measured_under_law(model, law, devices, progress);
  };
  start();
  SettingsRequest elastic;
  elastic.law = "elastic";
  ASSERT_EQ(error_of(elastic).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->state().law_failure.has_value(); }));
  EXPECT_EQ(live_->state().law_failure->where, "elastic");
  EXPECT_EQ(live_->state().law, "layers");
  EXPECT_EQ(live_->state().law_awaited, "");
  // the memory limit is respected
  set_reading_limits({.max_memory_bytes = 1});
  ASSERT_EQ(error_of(elastic).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->state().law_failure.has_value(); }));
  set_reading_limits({});
  EXPECT_THAT(live_->state().law_failure->what, HasSubstr("of memory"));
  ASSERT_EQ(error_of(elastic).what, "no error");
  EXPECT_FALSE(live_->state().law_failure);
  EXPECT_TRUE(soon([&] { return live_->state().law == "elastic"; }));
  // a script's request is answered as well
  live_->change_law_by_script(TissueLaw::kElastic);
  EXPECT_EQ(live_->script_law_version(), live_->state().model_version);
}

// the session continues, viewers are told, and the run replays
TEST_F(Viewed, ReportsSolverOutOfMemory) {
  shell_ = ElasticConstants{60, 0.45};
  std::atomic<bool> is_full{false};
  std::atomic<int> refused{0};
  solve_tissue_ = [&](SoftTissueSolver& solver, const Model& model, const TickRecord& tick) {
    solver.solve(model, tick);
    // the solver is left as after half a frame
    if (is_full && ++refused > 0) throw std::bad_alloc();
  };
  start();
  SettingsRequest elastic;
  elastic.law = "elastic";
  ASSERT_EQ(error_of(elastic).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->state().law == "elastic"; }));
  press(1);
  ASSERT_TRUE(soon([&] { return live_->deformation(0) != nullptr && latest().device[0].contact_N[0] > 0; }));
  // a solution takes some frames to settle
  const std::uint32_t frame = latest().solver_frame;
  ASSERT_TRUE(soon([&] { return latest().solver_frame >= frame + 20; }));
  const double solved_N = latest().device[0].contact_N[0];
  EXPECT_FALSE(live_->state().law_failure);

  is_full = true;
  ASSERT_TRUE(soon([&] { return live_->state().law_failure.has_value(); }));
  EXPECT_EQ(live_->state().law_failure->where, "elastic");
  EXPECT_THAT(live_->state().law_failure->what, HasSubstr("memory ran out"));
  EXPECT_EQ(live_->state().law, "elastic");
  EXPECT_TRUE(soon([&] { return live_->deformation(0) == nullptr; }));
  // 3 mm of tissue on bone are stiffer than a half-space of it
  EXPECT_TRUE(soon([&] {
    const double N = latest().device[0].contact_N[0];
    return N > 0 && N < 0.98 * solved_N;
  })) << latest().device[0].contact_N[0]
      << " N after " << solved_N;
  ASSERT_TRUE(soon([&] { return refused >= 2; })) << "it is tried again";

  is_full = false;
  ASSERT_TRUE(soon([&] { return !live_->state().law_failure && live_->deformation(0) != nullptr; }));
  EXPECT_TRUE(soon([&] { return std::abs(latest().device[0].contact_N[0] / solved_N - 1) < 0.01; }))
      << latest().device[0].contact_N[0] << " N after " << solved_N;

  live_->end();
  EXPECT_THAT(live_->later_tissue_warnings(), ::testing::Contains(HasSubstr("memory ran out")));
  loop_->stop();
  Recording recording;
  recording.header.model_hash = model_->content_hash;
  recording.header.model_version = model_->version;
  recording.header.tissue_cell_factor = model_->tissue_cell_factor;
  recording.ticks = ticks();
  recording.events.assign(reported().begin(), reported().end());
  const auto replayed = replay(recording, model_);
  ASSERT_TRUE(replayed.ok()) << replayed.error().message();
  EXPECT_TRUE(replayed->identical) << replayed->difference;
}

TEST_F(Viewed, ReturningToTheProxyCancelsPreparation) {
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedBone;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 1.0;
  ASSERT_EQ(error_of(softer).what, "no error");
  live_->next_method();  // the method after the proxy is the trilinear one
  SettingsRequest proxy;
  proxy.method = "proxy";
  ASSERT_EQ(error_of(proxy).what, "no error");
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  // a script's method gets its fields
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kSmoothSphere; });
  ASSERT_TRUE(soon([&] {
    live_->follow_script();
    const TickRecord tick = latest();
    return tick.method == index_of(ForceMethod::kSmoothSphere) && tick.model_version >= 3 &&
           (tick.device[0].flags & kFlagMethodMissing) == 0;
  }));
}

// a session by the proxy starts without the field of the direct methods and makes it on demand, beside the
// loop and without a new version of the model
TEST_F(Viewed, ProxySessionBuildsTheFieldOnDemand) {
  proxy_alone_ = true;
  prepare_methods_ = [](auto model, auto methods, const Progress& progress) {
    return prepared_for(std::move(model), methods, {}, progress);
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  press(1);
  EXPECT_FALSE(model_->has(ForceMethod::kTrilinear));
  const double by_proxy_N = sent_N(latest());
  EXPECT_GT(by_proxy_N, 0.5);
  SettingsRequest request;
  for (const char* direct : {"trilinear", "b-spline", "proxy", "trilinear"}) {
    request.method = direct;
    ASSERT_EQ(error_of(request).what, "no error");
    const ForceMethod method = *find_force_method(direct);
    ASSERT_TRUE(soon([&] { return latest().method == index_of(method); })) << direct;
    EXPECT_FALSE(live_->state().method_failure) << direct;
    // on a loaded machine a late tick fades the force in again
    EXPECT_TRUE(soon([&] {
      const TickRecord now = latest();
      return (now.device[0].flags & (kFlagBlend | kFlagMethodMissing)) == 0 &&
             std::abs(sent_N(now) - by_proxy_N) < 0.25 * by_proxy_N;
    })) << direct
        << ": " << sent_N(latest()) << " N, by the proxy " << by_proxy_N << " N";
  }
  EXPECT_TRUE(changes().empty()) << "a prepared method is no other model";
  for (const TickRecord& tick : ticks()) EXPECT_EQ(tick.device[0].flags & kFlagMethodMissing, 0u);
}

TEST_F(Viewed, ProxySessionBuildsTheFieldForTheCurrentStiffness) {
  proxy_alone_ = true;
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.3;
  ASSERT_EQ(error_of(softer).what, "no error");
  SettingsRequest direct;
  direct.method = "trilinear";
  ASSERT_EQ(error_of(direct).what, "no error");
  ASSERT_TRUE(soon([&] { return live_->state().method == ForceMethod::kTrilinear; }));
  const auto made = changes();
  ASSERT_EQ(made.size(), 2u);
  EXPECT_EQ(made[1].tissue, ModelChange::kFieldsRebuilt);
}

// out of memory, unsuitable values: the session continues, and the error is reported
TEST_F(Viewed, ReportsFieldPreparationFailure) {
  using Made = Result<std::shared_ptr<const Model>>;
  std::atomic<int> tries{0};
  rebuild_fields_ = [&](const Model& model, const Model& made, const Progress& progress) -> Made {
    switch (++tries) {
      case 1:
        throw std::bad_alloc();
      case 2:
        throw std::runtime_error("no thread");
      case 3:
        return Error{ErrorKind::kBadInput, "the shell is too thin", "label 2", "make it thicker"};
      case 4:
        return with_rebuilt_fields(model, made, progress);
      default: {
        // a model with the one method that a tick requires
        auto bare = std::make_shared<Model>(model);
        bare->methods = {};
        bare->methods[index_of(ForceMethod::kTrilinear)] = model.methods[index_of(ForceMethod::kTrilinear)];
        return std::shared_ptr<const Model>(std::move(bare));
      }
    }
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedCartilage;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.3;
  ASSERT_EQ(error_of(softer).what, "no error");
  SettingsRequest direct;
  direct.method = "b-spline";
  for (const char* why : {"bad_alloc", "no thread", "the shell is too thin"}) {
    ASSERT_EQ(error_of(direct).what, "no error");
    ASSERT_TRUE(soon([&] { return live_->state().method_failure.has_value(); })) << why;
    const ViewedState state = live_->state();
    EXPECT_THAT(state.method_failure->what, HasSubstr(why));
    EXPECT_EQ(state.method_failure->where, "b-spline");
    EXPECT_FALSE(state.method_failure->remedy.empty());
    EXPECT_EQ(state.method, ForceMethod::kProxy);
    EXPECT_EQ(state.method_awaited, "");
    EXPECT_TRUE(loop_->running());
  }
  // another attempt may succeed
  ASSERT_EQ(error_of(direct).what, "no error");
  EXPECT_FALSE(live_->state().method_failure);
  EXPECT_TRUE(soon([&] { return live_->state().method == ForceMethod::kSpline; }));
  EXPECT_EQ(live_->state().method_awaited, "");

  // a method missing in the new fields is prepared separately
  SettingsRequest proxy;
  proxy.method = "proxy";
  ASSERT_EQ(error_of(proxy).what, "no error");
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 0.4;
  ASSERT_EQ(error_of(softer).what, "no error");
  ASSERT_EQ(error_of(direct).what, "no error");
  EXPECT_TRUE(soon([&] { return live_->state().method == ForceMethod::kSpline; }));
  EXPECT_EQ(tries, 5);
}

// a script's method that cannot be prepared is replaced by the proxy
TEST_F(Viewed, ReportsMethodFailureOfAScript) {
  std::atomic<int> tries{0};
  rebuild_fields_ = [&](const auto&...) -> Result<std::shared_ptr<const Model>> {
    ++tries;
    throw std::bad_alloc();
  };
  start(true, {}, std::numeric_limits<double>::infinity(), true);
  TissueRequest softer;
  softer.tissue = kViewedBone;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 1.0;
  ASSERT_EQ(error_of(softer).what, "no error");
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kSmoothSphere; });
  ASSERT_TRUE(soon([&] {
    live_->follow_script();
    return live_->method_failure().has_value();
  }));
  EXPECT_EQ(live_->method_failure()->where, "smooth-sphere");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  EXPECT_TRUE(soon([&] { return latest().method == index_of(ForceMethod::kProxy); }));
  // no repeated attempts
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kSpline; });
  for (int n = 0; n < 10; ++n) live_->follow_script();
  EXPECT_EQ(live_->state().method_awaited, "");
  EXPECT_EQ(live_->method_failure()->where, "b-spline");
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
  EXPECT_EQ(tries, 1);
}

TEST_F(Viewed, ReportsAScriptsMethodWithStaleFields) {
  start();
  TissueRequest softer;
  softer.tissue = kViewedBone;
  softer.changes[&ContactProperties::stiffness_N_per_mm] = 1.0;
  ASSERT_EQ(error_of(softer).what, "no error");
  loop_->change([](Parameters& parameters) { parameters.method = ForceMethod::kSpline; });
  live_->follow_script();
  ASSERT_TRUE(live_->method_failure());
  EXPECT_EQ(live_->method_failure()->where, "b-spline");
  EXPECT_THAT(live_->method_failure()->what, HasSubstr("other stiffness values"));
  EXPECT_EQ(live_->state().method, ForceMethod::kProxy);
}

}  // namespace
}  // namespace palpate
