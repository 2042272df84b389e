#pragma once

/// Gives tests of other modules the loop without its thread, so that they can supply samples one by one.
#include "servo/loop.h"
