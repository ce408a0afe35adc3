"""What happens in an episode: start, goal, and the people who meet the robot."""
