"""Building blocks for methods.

- `networks`: `Network`, `SeedVector` and `Adam`, all seeds in one tensor;
- `policies`: a deterministic policy and two Gaussian ones, each with its regression;
- `discriminator`: expert states against offline ones, for a reward;
- `modules`: `PerSeed`, an ordinary `torch.nn.Module` for every seed.

`perceptron` is an inner part of `networks`.
"""
