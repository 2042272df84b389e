// edited_session FILE press|mill
//
// Explores the tests' ball on the real clock, with five edits per second, until it is killed: either pressed
// by a script, or milled by a burr that a pointer leads around it. Writes one byte to standard output per
// edit. For killed_session_test.cc.
#include "session/test_edited_session.h"

#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <string_view>

#include "loading/test_loading.h"
#include "palpate/session/explore.h"

int main(int count, char** arguments) {
  using namespace palpate;
  using Clock = std::chrono::steady_clock;
  if (count != 3) {
    std::fprintf(stderr, "usage: edited_session FILE press|mill\n");
    return 2;
  }
  const bool mills = std::string_view(arguments[2]) == "mill";
  constexpr auto kPeriod = std::chrono::milliseconds(200);
  const auto script = parse_script(
      "[[step]]\napproach = \"ball\"\nspeed = 200.0\n[[step]]\npress = 0.8\n[[step]]\nhold = 60.0\n",
      "edited session");
  PALPATE_CHECK(script.ok());
  LiveHost* host = nullptr;
  std::uint32_t edits = 0;
  Clock::time_point next = Clock::now();
  ExploreOptions options;
  options.loop.realtime = false;
  options.loop.ring_s = 30;
  options.viewers = [&](LiveHost& session) -> Result<std::shared_ptr<void>> {
    host = &session;
    return std::shared_ptr<void>();
  };
  if (mills) options.devices = {kPointer};
  const Clock::time_point begun = Clock::now();
  options.request = [&] {
    if (mills) {
      if (edits == 0) PALPATE_CHECK(host->claim_pointer(true, {1, true}).ok());
      // around the ball, in and out by a millimetre; during the first second it waits outside until the force
      // is on
      const double time_s = std::chrono::duration<double>(Clock::now() - begun).count();
      const double r = palpate::testing::kBoneRadius_mm + 2 + (time_s < 1 ? 5 : std::cos(5 * time_s));
      const double turn = 0.7 * time_s;
      host->move_pointer(PointerTarget{{r * std::cos(turn), 0, r * std::sin(turn)}});
    }
    if (Clock::now() < next) return ExploreRequest::kNone;
    next = Clock::now() + kPeriod;
    ++edits;
    PALPATE_CHECK(mills ? palpate::testing::ask_for_stroke_edit(*host, edits)
                        : palpate::testing::ask_for_edit(*host, edits));
    PALPATE_CHECK(::write(STDOUT_FILENO, ".", 1) == 1);
    return ExploreRequest::kNone;
  };
  const LoadedScene loaded = mills ? palpate::testing::loaded_burr() : palpate::testing::loaded_ball();
  const auto explored = explore(loaded, *script, options, arguments[1]);
  std::fprintf(stderr, "%s\n", explored ? "ended by itself" : explored.error().message().c_str());
  return 1;
}
