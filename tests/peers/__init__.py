"""What independent programs say of the same problem: values of their own tests, or what they answer here, beside ours."""
