// libfranka's own loop with a controller that does nothing: `noop ADDRESS MILLISECONDS`.
#include <cstdlib>
#include <iostream>

#include <franka/exception.h>
#include <franka/robot.h>

int main(int, char** words) {
  const long ticks = std::atol(words[2]);
  try {
    franka::Robot robot(words[1], franka::RealtimeConfig::kIgnore);
    long tick = 0;
    robot.control(
        [&](const franka::RobotState&, franka::Duration) -> franka::Torques {
          franka::Torques none{{0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0}};
          return ++tick < ticks ? none : franka::MotionFinished(none);
        },
        false, franka::kMaxCutoffFrequency);
  } catch (const franka::Exception& error) {
    std::cerr << error.what() << std::endl;
    return 1;
  }
  return 0;
}
