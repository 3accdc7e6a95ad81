"""What tests share: arms, made results, exact solutions."""
