#include "palpate/doctor/doctor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "base/test_folder.h"
#include "doctor/machine.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

void write_file(const std::filesystem::path& file, const std::string& text) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file) << text << "\n";
}

TEST(Doctor, ExplainsHowToGrantRealtimePermissions) {
  RealtimeGrant none;
  none.scheduler = "SCHED_OTHER (SCHED_FIFO refused)";
  none.memory = "not locked (refused)";
  for (const DoctorLine& line : {priority_line(none, "anna"), memory_line(none, "anna")}) {
    EXPECT_EQ(line.finding, Finding::kMissing);
    // can be entered as shown
    EXPECT_THAT(line.remedy, HasSubstr("sudo usermod -aG haptics anna\n"));
    EXPECT_THAT(line.remedy, HasSubstr("/etc/security/limits.d/palpate.conf"));
    EXPECT_THAT(line.remedy, HasSubstr("log out and in again"));
  }
  EXPECT_THAT(priority_line(none, "").remedy, HasSubstr("NAME (the account"));
  RealtimeGrant part{.fifo = true, .priority = 49, .memory_locked = true};
  part.memory = "locked (current mappings only; later allocations are not locked)";
  EXPECT_EQ(priority_line(part, "anna").finding, Finding::kMissing);
  EXPECT_EQ(memory_line(part, "anna").finding, Finding::kAdvice);
  RealtimeGrant all{.fifo = true, .priority = 95, .memory_locked = true};
  all.memory = "locked";
  for (const DoctorLine& line : {priority_line(all, "anna"), memory_line(all, "anna")}) {
    EXPECT_EQ(line.finding, Finding::kFine);
    EXPECT_EQ(line.remedy, "");
  }
}

TEST(Doctor, ReadsGovernorsAndTheKernel) {
  const test::TemporaryFolder root;
  EXPECT_EQ(governor_line(root.path()).finding, Finding::kFine) << "a virtual machine has none";
  const auto cpus = root.path() / "sys/devices/system/cpu";
  write_file(cpus / "cpu0/cpufreq/scaling_governor", "performance");
  EXPECT_EQ(governor_line(root.path()).finding, Finding::kFine);
  write_file(cpus / "cpu1/cpufreq/scaling_governor", "powersave");
  write_file(cpus / "cpu2/cpufreq/scaling_governor", "powersave");
  const DoctorLine slow = governor_line(root.path());
  EXPECT_EQ(slow.finding, Finding::kAdvice);
  EXPECT_THAT(slow.found, HasSubstr("'powersave' on 2 cores"));
  EXPECT_THAT(slow.remedy, HasSubstr("cpupower"));

  EXPECT_EQ(kernel_line(root.path()).finding, Finding::kAdvice);
  write_file(root.path() / "proc/sys/kernel/osrelease", "6.1.0-18-rt-amd64");
  write_file(root.path() / "sys/kernel/realtime", "1");
  EXPECT_EQ(kernel_line(root.path()).finding, Finding::kFine);
  EXPECT_THAT(kernel_line(root.path()).found, HasSubstr("6.1.0-18-rt-amd64"));
}

TEST(Doctor, ReportsALateTimer) {
  TimerFigures timer{.seconds = 5, .rate_hz = 1000, .p50_us = 20, .p99_us = 60, .max_us = 300, .on_time = 1};
  EXPECT_EQ(timer_line(timer, true).finding, Finding::kFine);
  timer.on_time = 0.93;
  const DoctorLine with_rights = timer_line(timer, true), without = timer_line(timer, false);
  EXPECT_EQ(with_rights.finding, Finding::kMissing);
  EXPECT_THAT(without.remedy, HasSubstr("permissions"));
  EXPECT_THAT(with_rights.remedy, Not(HasSubstr("permissions")));
}

DeviceRegistry two_devices(bool first_ready) {
  DeviceRegistry known;
  known.add({"first", "a first one", {}, [first_ready] {
               DeviceReport report;
               report.checks.push_back(
                   {"its library", first_ready, first_ready ? "there" : "no libfirst.so", "install it"});
               if (first_ready) report.connected.push_back({"1", "ready"});
               return report;
             }});
  known.add({"second", "a second one", {}, [] {
               DeviceReport report;
               report.checks.push_back({"its service", false, "nobody answers", "start it"});
               return report;
             }});
  return known;
}

std::vector<DoctorLine> of(const DoctorReport& report, const std::string& topic) {
  std::vector<DoctorLine> lines;
  for (const DoctorLine& line : report.lines)
    if (line.topic == topic) lines.push_back(line);
  return lines;
}

TEST(Doctor, LooksAtEveryDeviceAndEveryFaultHasItsCure) {
  const auto report = examine(two_devices(false), {.timer_s = 0.1});
  ASSERT_TRUE(report.ok()) << report.error().message();
  EXPECT_TRUE(report->missing());
  ASSERT_EQ(of(*report, "first").size(), 1u);
  EXPECT_EQ(of(*report, "first")[0].found, "no libfirst.so");
  EXPECT_EQ(of(*report, "second")[0].finding, Finding::kMissing);
  EXPECT_EQ(of(*report, "this computer").size(), 5u);
  for (const DoctorLine& line : report->lines) {
    EXPECT_FALSE(line.found.empty()) << line.what;
    EXPECT_EQ(line.remedy.empty(), line.finding == Finding::kFine) << line.what;
  }
  EXPECT_EQ(report->timer.rate_hz, 1000);
  EXPECT_GT(report->timer.p50_us, 0);
  EXPECT_LE(report->timer.on_time, 1);
}

TEST(Doctor, OneReadyDeviceSufficesUnlessMoreAreRequested) {
  const auto any = examine(two_devices(true), {.timer_s = 0.1});
  ASSERT_TRUE(any.ok());
  EXPECT_EQ(of(*any, "second")[0].finding, Finding::kAdvice);
  const auto both = examine(two_devices(true), {.timer_s = 0.1, .devices = {"first", "second"}});
  ASSERT_TRUE(both.ok());
  EXPECT_EQ(of(*both, "second")[0].finding, Finding::kMissing);
  const auto first = examine(two_devices(true), {.timer_s = 0.1, .devices = {"first"}});
  ASSERT_TRUE(first.ok());
  EXPECT_TRUE(of(*first, "second").empty());
  const auto spoon = examine(two_devices(true), {.timer_s = 0.1, .devices = {"spoon"}});
  ASSERT_FALSE(spoon.ok());
  EXPECT_EQ(spoon.error().kind, ErrorKind::kUsage);
  EXPECT_THAT(spoon.error().remedy, HasSubstr("first, second"));
}

TEST(Doctor, CanBeInterrupted) {
  const std::atomic<bool> stop{true};
  const auto report = examine(two_devices(true), {.timer_s = 60}, Progress({}, &stop));
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
