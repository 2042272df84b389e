#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

/// Validated options.
namespace palpate::app {

/// Validator of a finite number in the closed interval low ... high.
CLI::Validator number_between(double low, double high);
/// Adds an option with `count` comma-separated numbers, each in -largest ... largest.
CLI::Option* add_numbers(CLI::App& verb, const std::string& name, std::vector<double>& numbers, int count,
                         double largest, const std::string& help);
/// Validator of an integer in decimal digits in the closed interval low ... high.
CLI::Validator whole_between(std::uint64_t low, std::uint64_t high);

}  // namespace palpate::app
