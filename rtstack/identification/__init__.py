"""What a robot's friction is: Appendix A of the impact-map paper, as a procedure that runs on the robot."""
