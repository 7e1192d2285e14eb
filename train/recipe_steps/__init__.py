"""Steps of the recipe: plan, queue, jobs and progress."""
