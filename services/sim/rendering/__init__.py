"""Off-screen pictures: the stereo cameras and the pictures of scenes and tasks."""
